"""One run of the zoo: figures of the filter, of the paper's open loop and of a spline on one body."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from functools import cache, partial
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline, RBFInterpolator

from dynamics import MassSpringNetwork, NetworkError
from estimators import OpenLoop, TissueFilter
from experiments.arrays import Floats
from experiments.simulation.bodies.body import Body
from experiments.studies.estimation.trials import Frames, Model
from experiments.studies.zoo.case import Case, NotIdentifiedError, assumed, identified, measured
from experiments.studies.zoo.scores import Followed, followed, hidden_scores, mean_distance

FLAT = 1e-3
"""A body is flat in a direction if the extent in this direction is at most this share of the largest extent."""


def open_loop(network: MassSpringNetwork, body: Body, frames: Frames) -> Floats | None:
    """Positions of hidden nodes by the paper's method [m], (n_frames, n_hidden, dim); None if it cannot start."""
    try:
        method = OpenLoop(network, body.hidden[0])
    except NetworkError:
        return None
    nodes = [network.index(name) for name in body.hidden]
    places = []
    with np.errstate(all="ignore"):  # if the method diverges, its error is infinite
        for time_s, seen in frames:
            method.update(time_s, seen)
            places.append(method.positions[nodes].copy())
    return np.array(places)


def spline(body: Body, frames: Frames) -> Floats:
    """Positions of hidden nodes [m], (n_frames, n_hidden, dim), from a spline through marks and fixed nodes.

    If the nodes are in a line, the spline is cubic along the line. Otherwise a thin-plate spline interpolates the
    displacements from the drawn shape.
    """
    network, drawn = body.network, body.network.positions
    seen, hidden = ([network.index(name) for name in names] for names in (body.marked, body.hidden))
    anchors = np.flatnonzero(network.fixed)
    known = np.r_[anchors, seen]
    places = np.array([np.vstack([drawn[anchors], [mark.position for mark in marks]]) for _, marks in frames])
    if body.in_line:
        along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(drawn, axis=0), axis=1))]
        order = np.argsort(along[known])
        line = CubicSpline(along[known][order], places[:, order], axis=1)
        return np.asarray(line(along[hidden]))
    return drawn[hidden] + thin_plate_weights(drawn[known], drawn[hidden]) @ (places - drawn[known])


def thin_plate_weights(known: Floats, wanted: Floats) -> Floats:
    """Weights of a thin-plate spline from `known` to `wanted` points, each (n, dim); result: (n_wanted, n_known)."""
    center = known.mean(axis=0)
    _, extents, axes = np.linalg.svd(known - center, full_matrices=False)
    kept = axes[extents > FLAT * extents[0]]
    found = RBFInterpolator((known - center) @ kept.T, np.eye(len(known)), kernel="thin_plate_spline")
    return np.asarray(found((wanted - center) @ kept.T))


Record = dict[str, Any]

LIMIT_S = 60.0
"""Limit of the filter's processor time in a run [s]."""

KERNELS_S = 0.5
"""Length of the recordings of `compile_kernels` [s]; numerical."""


def run(case: Case) -> Record:
    """Figures of a case: errors of filter, open loop and spline [m], coverage, NEES, failures, time per frame [ms]."""
    body = case.motion
    hidden = [body.network.index(name) for name in body.hidden]
    truth = body.positions[:, hidden]
    record: Record = {"frames": len(truth), "frames_done": 0, "size_m": body.size_m}
    compile_kernels()
    try:
        model = assumed(body, case)
    except (NotIdentifiedError, NetworkError) as error:
        return record | {"ended": str(error)}
    found = filtered(model, body, case.seed, LIMIT_S)
    done = len(found.status)
    compared = slice(done or None)  # references are scored in the same frames as the filter
    frames = measured(body, body.marked, case.seed)[compared]
    simulated = open_loop(model.network, body, frames)
    record |= {
        "spline_m": mean_distance(spline(body, frames), truth[compared]),
        "open_loop_m": None if simulated is None else mean_distance(simulated, truth[compared]),
        "ended": found.failure,
        "frames_done": done,
        "ms_a_frame": 1e3 * found.seconds / max(done, 1),
        "repairs": sum(found.repairs.values()),
        "repairs_by_kind": json.dumps(found.repairs),
        "status": json.dumps(Counter(map(str, found.status))),
    }
    if done:
        record |= hidden_scores(found.means, found.covs, truth[:done], tracking=found.tracking, size_m=body.size_m)
    return record


def record_of(case: Mapping[str, Any]) -> Record:
    """The result of `run`; case: the fields of a `Case` by name."""
    return run(Case.from_json(case))


@cache
def compile_kernels() -> None:
    """Compile the code of identification and filter before runs are timed. Only the first call in a process acts."""
    for name in ("chain2", "phantom"):
        case = Case(name, 0, "identified", length_s=KERNELS_S)
        model = identified(case.motion, case, np.random.default_rng(0), seconds=np.inf)
        filtered(model, case.motion, 0, np.inf)


def filtered(model: Model, body: Body, seed: int, limit_s: float) -> Followed:
    """Run the filter on noisy marks of the body; limit_s: limit of its processor time [s]."""
    begun = partial(
        TissueFilter, model.network, body.hidden[0], body.marked, model.settings, uncertainty=model.uncertainty
    )
    return followed(begun, model.network, body.hidden, measured(body, body.marked, seed), limit_s)
