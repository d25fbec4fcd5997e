"""Test of the filter for a continuum on soft bodies whose meshes, material laws and integrators differ from its own.

    python -m experiments.studies.soft_bodies --out DIR    # --page writes the table to docs/meshes.md

MuJoCo simulates the true blocks; neo-Hookean elements simulate the true breasts. Marks on the skin are accurate to
0.5 mm, the target is hidden, and the stiffness is known to a factor of two. The filter's constants were chosen with
seeds 0 to 3. DIR gets the runs, summary.json and table.md; an interrupted study continues there.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from dynamics import ParameterUncertainty, parameters
from estimators import OpenLoop, TargetEstimate, TissueFilter, coverage, normalised_error_squared
from experiments.arrays import Floats
from experiments.engine.runs import Case
from experiments.formats.outputs import write_whole
from experiments.formats.page import markdown_table
from experiments.studies.estimation.trials import Frames, frames_of
from experiments.studies.grid import command, grid, kept_runs, publish, seeds_of, study_options
from experiments.studies.soft_bodies.bodies import BODIES, UNCERTAIN, Recording
from experiments.studies.zoo.run import thin_plate_weights

MARK_SD_M = 5e-4
SKIPPED = 15
"""Number of frames at the start of a recording that are not evaluated."""
AHEAD, EVERY = 9, 3
"""From every third frame, the target is predicted nine frames ahead, which are 0.3 s."""


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
    ours, ahead, ms = _passed(tissue, frames)
    loops = [loop.update(time_s, marks).mean for time_s, marks in frames]
    truth, means = case.positions[:, -1], np.array([one.mean for one in ours])
    errors, then = means - truth, truth[SKIPPED + AHEAD :: EVERY]
    nees = normalised_error_squared(errors, np.array([one.cov for one in ours]))
    missed = np.array([one.mean for one in ahead]) - then
    return {
        "moved_mm": 1e3 * float(np.linalg.norm(truth - truth[0], axis=1).max()),
        "skin_mm": 1e3 * float(np.linalg.norm((case.positions - case.positions[0])[:, :-1], axis=2).max()),
        "filter_mm": _rms_mm(errors),
        "open_loop_mm": _rms_mm(np.array(loops) - truth),
        "thin_plate_mm": _rms_mm(_spline(case, seen) - truth),
        "covered": coverage(nees[SKIPPED:], 3),
        "kept_mm": _rms_mm(means[SKIPPED:-AHEAD:EVERY] - then, 0),
        "ahead_mm": _rms_mm(missed, 0),
        "ahead_covered": coverage(normalised_error_squared(missed, np.array([one.cov for one in ahead])), 3),
        "ms": ms,
    }


def _spline(case: Recording, seen: Floats) -> Floats:
    """The target's positions from a thin-plate spline through the marks and the fixed wall [m], (n_frames, 3)."""
    drawn, network = case.positions[0], case.network
    wall = network.positions[network.fixed & network.is_held]
    weights = thin_plate_weights(np.vstack([drawn[:-1], wall]), drawn[-1:])[0]
    return np.asarray(drawn[-1] + weights[: len(case.marked)] @ (seen - drawn[:-1]))


def _passed(tissue: TissueFilter, frames: Frames) -> tuple[list[TargetEstimate], list[TargetEstimate], float]:
    """Estimates of all frames, predictions from every `EVERY`-th frame after `SKIPPED`, and time per estimate [ms]."""
    ours, ahead, spent_s = list[TargetEstimate](), list[TargetEstimate](), 0.0
    for k, (time_s, marks) in enumerate(frames):
        began = time.process_time()
        tissue.predict(time_s)
        ours.append(tissue.update(marks))
        spent_s += time.process_time() - began
        if k in range(SKIPPED, len(frames) - AHEAD, EVERY):
            ahead.append(tissue.predict_at(frames[k + AHEAD][0]))
    return ours, ahead, 1e3 * spent_s / len(frames)


def _rms_mm(errors: Floats, first: int = SKIPPED) -> float:
    return 1e3 * float(np.sqrt((errors[first:] ** 2).sum(axis=1).mean()))


FIGURES = {
    "skin_mm": "skin moves by [mm]",
    "moved_mm": "target moves by [mm]",
    "filter_mm": "filter [mm]",
    "open_loop_mm": "open loop [mm]",
    "thin_plate_mm": "thin-plate spline [mm]",
    "covered": "filter covered",
    "kept_mm": "estimate 0.3 s later [mm]",
    "ahead_mm": "prediction 0.3 s ahead [mm]",
    "ahead_covered": "prediction covered",
}
"""Headings of the table's columns. The table has means over recordings."""


def summary(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """A row for each body, with means over its recordings."""
    bodies = rows.groupby("body", sort=False)
    means = bodies[[*FIGURES, "ms"]].mean()
    means.insert(0, "n", bodies.size())
    return means.reset_index().to_dict("records")


def markdown(found: Sequence[dict[str, Any]]) -> str:
    """The table of docs/meshes.md."""
    rows = []
    for one in found:
        figures = [f"{100 * one[key]:.0f} %" if "covered" in key else f"{one[key]:.2f}" for key in FIGURES]
        rows.append((one["body"], *figures))
    return markdown_table(("body", *FIGURES.values()), rows)


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Do the runs that the output folder lacks, and write the results."""
    parser = study_options(__doc__, page="meshes.md", seeds=(6, 20))
    parser.add_argument("--bodies", action="append", choices=list(BODIES), help="name of a body; repeat for several")
    given = parser.parse_args(arguments)
    cases = grid(body=given.bodies or BODIES, seed=seeds_of(given))
    found = summary(kept_runs(run, cases, given.out, given).checked())
    page = markdown(found)
    write_whole(given.out / "summary.json", json.dumps({"rows": found}, indent=2) + "\n")
    publish(given, page, {"soft bodies table": page}, given.out / "table.md")


if __name__ == "__main__":
    sys.exit(main())
