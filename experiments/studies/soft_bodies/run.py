"""The hidden target of a soft body, estimated by the filter, the open loop and a spline from the same marks."""

from __future__ import annotations

import time

import numpy as np

from dynamics import ParameterUncertainty, parameters
from estimators import OpenLoop, TissueFilter, coverage, normalised_error_squared
from experiments.arrays import Floats
from experiments.engine.runs import Case
from experiments.studies.estimation.trials import frames_of, passed
from experiments.studies.soft_bodies.bodies import BODIES, UNCERTAIN, Recording
from experiments.studies.zoo.references import thin_plate_weights

MARK_SD_M = 5e-4
SKIPPED = 15
"""Number of frames at the start that no figure uses."""


def run(job: Case) -> dict[str, float]:
    """Figures of one recording; job: `body` and `seed`."""
    seed = int(job["seed"])
    case = BODIES[job["body"]](seed)
    rng = np.random.default_rng([seed, 3])
    seen = case.positions[:, :-1] + MARK_SD_M * rng.normal(size=case.positions[:, :-1].shape)
    frames = frames_of(case.times_s, seen, case.marked, MARK_SD_M)
    uncertain = parameters(case.network)
    stated = ParameterUncertainty(uncertain, UNCERTAIN**2 * np.eye(len(uncertain)))
    tissue = TissueFilter(case.network, "target", case.marked, uncertainty=stated)
    loop = OpenLoop(case.network, "target")
    began = time.process_time()
    ours = passed(tissue, frames)
    ms = 1e3 * (time.process_time() - began) / len(frames)
    loops = [loop.update(time_s, marks).mean for time_s, marks in frames]
    truth = case.positions[:, -1]
    errors = np.array([one.mean for one in ours]) - truth
    nees = normalised_error_squared(errors, np.array([one.cov for one in ours]))
    return {
        "moved_mm": 1e3 * float(np.linalg.norm(truth - truth[0], axis=1).max()),
        "skin_mm": 1e3 * float(np.linalg.norm((case.positions - case.positions[0])[:, :-1], axis=2).max()),
        "filter_mm": _rms_mm(errors),
        "open_loop_mm": _rms_mm(np.array(loops) - truth),
        "thin_plate_mm": _rms_mm(_spline(case, seen) - truth),
        "covered": coverage(nees[SKIPPED:], 3),
        "ms": ms,
    }


def _spline(case: Recording, seen: Floats) -> Floats:
    """Positions of the target by a thin-plate spline through marks and fixed wall [m], (n_frames, 3)."""
    drawn, network = case.positions[0], case.network
    wall = network.positions[network.fixed & network.is_held]
    weights = thin_plate_weights(np.vstack([drawn[:-1], wall]), drawn[-1:])[0]
    return np.asarray(drawn[-1] + weights[: len(case.marked)] @ (seen - drawn[:-1]))


def _rms_mm(errors: Floats) -> float:
    return 1e3 * float(np.sqrt((errors[SKIPPED:] ** 2).sum(axis=1).mean()))
