"""One run of the zoo: figures of the filter and of the reference methods on one body."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from functools import cache, partial
from typing import Any

import numpy as np

from dynamics import NetworkError
from estimators import TissueFilter
from experiments.simulation.bodies.body import Body
from experiments.studies.estimation.trials import Model
from experiments.studies.zoo.case import Case
from experiments.studies.zoo.constants import NotIdentifiedError, assumed, identified, measured
from experiments.studies.zoo.references import open_loop, spline
from experiments.studies.zoo.scores import Followed, followed, hidden_scores, mean_distance

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
    """The result of `run`; case: its fields as JSON types, which `run_study` passes."""
    return run(Case.from_json(case))


@cache
def compile_kernels() -> None:
    """Identify and filter two small bodies, once in each process, to load compiled code before runs are timed."""
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
