"""One run of the zoo: a body before the filter and its rivals, as a record of numbers."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from dynamics import NetworkError
from estimators import FilterSettings, MarkMeasurement, Status, TissueFilter
from estimators.process.target import target_map
from experiments.arrays import Floats
from experiments.simulation.bodies.body import Body
from experiments.studies.zoo.case import Case
from experiments.studies.zoo.constants import Assumed, NotIdentifiedError, assumed, identified, measured
from experiments.studies.zoo.rivals import open_loop, spline
from experiments.studies.zoo.scores import hidden_scores, mean_distance

Record = dict[str, Any]

KERNELS_S = 0.5
"""Length of the recordings with which compiled code is loaded [s]; numerical."""


@dataclass(slots=True, eq=False)
class Filtered:
    """What the filter made of a recording, until it failed or its time was up.

    means: of the hidden nodes [m], (n, n_hidden, dim); covs [m²], (n, n_hidden, dim, dim); status: of each frame
    seconds: processor time of predict and update; repairs: counts by kind; failure: empty, or why it ended early
    """

    means: Floats
    covs: Floats
    status: list[str]
    seconds: float = 0.0
    repairs: Counter[str] = field(default_factory=Counter)
    failure: str = ""


def run(case: Case) -> Record:
    """The case's figures: errors [m] of filter, open loop and spline, coverage, NEES, faults, time a frame."""
    body = case.motion
    marks = measured(body, body.marked, case.seed)
    hidden = [body.network.index(name) for name in body.hidden]
    truth = body.positions[:, hidden]
    record: Record = {"frames": len(truth), "frames_done": 0, "size_m": body.size_m}
    compile_kernels()
    try:
        model = assumed(body, case)
    except (NotIdentifiedError, NetworkError) as error:
        return record | {"ended": str(error)}
    found = filtered(model, body, marks, limit_s=case.limit_s)
    done = len(found.status)
    compared = slice(done or None)  # rivals are scored in the frames that the filter was
    simulated = open_loop(model.network, body, marks[compared])
    record |= {
        "spline_m": mean_distance(spline(body, marks[compared]), truth[compared]),
        "open_loop_m": None if simulated is None else mean_distance(simulated, truth[compared]),
        "ended": found.failure,
        "frames_done": done,
        "ms_a_frame": 1e3 * found.seconds / max(done, 1),
        "repairs": sum(found.repairs.values()),
        "repairs_by_kind": json.dumps(found.repairs),
        "status": json.dumps(Counter(found.status)),
    }
    if done:
        tracking = np.array([status == Status.TRACKING for status in found.status])
        record |= hidden_scores(found.means, found.covs, truth[:done], tracking=tracking, size_m=body.size_m)
    return record


def record_of(case: Mapping[str, Any]) -> Record:
    """As `run`, of a case that JSON made: for `run_study`."""
    return run(Case.from_json(case))


@cache
def compile_kernels() -> None:
    """Identify and filter two small bodies, once in a process: compiled code is loaded before runs are timed."""
    for name in ("chain2", "phantom"):
        case = Case(name, 0, "identified", length_s=KERNELS_S)
        model = identified(case.motion, case, np.random.default_rng(0), seconds=np.inf)
        filtered(model, case.motion, measured(case.motion, case.motion.marked, 0), limit_s=np.inf)


def filtered(model: Assumed, body: Body, marks: Sequence[Sequence[MarkMeasurement]], *, limit_s: float) -> Filtered:
    """One run of the filter with its default settings: all hidden nodes are read from its state."""
    network = model.network
    dim, n_hidden = network.dim, len(body.hidden)
    means, covs = [], []
    found = Filtered(np.empty((0, n_hidden, dim)), np.empty((0, n_hidden, dim, dim)), [])
    start_s = time.process_time()
    try:
        with np.errstate(all="ignore"):  # a state that overflows is counted as such
            settings = FilterSettings(led_nodes=body.led)
            tissue = TissueFilter(network, body.hidden[0], body.marked, settings, uncertainty=model.uncertainty)
            maps = [target_map(network, name) for name in body.hidden]
            for time_s, seen in zip(body.times_s, marks, strict=True):
                tissue.predict(float(time_s))
                estimate = tissue.update(seen)
                found.repairs = Counter(tissue.repairs)
                places = [tissue.place_of(one) for one in maps]
                found.status.append(str(estimate.status))
                means.append([mean for mean, _ in places])
                covs.append([cov for _, cov in places])
                if time.process_time() - start_s > limit_s and len(means) < len(marks):
                    found.failure = f"stopped after {limit_s:g} s"
                    break
    except Exception as error:  # whatever a filter raises is a result of the study
        found.failure = f"{type(error).__name__}: {error}"
    found.seconds = time.process_time() - start_s
    if means:
        found.means, found.covs = np.array(means), np.array(covs)
    return found
