"""Coverage of the filter's 95 % region for different noise levels of the marks. The filter knows the exact constants.

    python -m experiments.studies.honesty --out FOLDER
    python -m experiments.studies.honesty --out FOLDER --bodies "four masses" --seeds 3

SciPy's DOP853 computes the truth. Marks have Gaussian noise of 0.3 to 30 mm per axis at 30 frames/s. The noise that the
scene states is exact, ten times too large, or three times too small. The body is at rest, or it is accelerated by a
breath (1, 2 or 4 m/s², period 3 to 6 s), by short forces (5 m/s²), or by both. The first second is not evaluated.

Latest coverage of both phantoms, with seeds 500 and 501. If the stated noise is exact, 59 of 60 cases have 97 to 100 %,
and the light phantom with a breath of 4 m/s² and 0.3 mm of noise has 81 %. If the stated noise is too large, all cases
have 88 to 100 %. If the stated noise is too small, cases with at most 4.14 mm of true noise have 88 to 100 %, other
cases 56 to 93 %.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import chi2

from estimators import Status, normalised_error_squared
from experiments.arrays import Floats
from experiments.formats.outputs import write_whole
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import FILTER, Line
from experiments.studies.estimation.trials import Frames, frames_of
from experiments.studies.faults.judge import is_wrong
from experiments.studies.faults.world import INTERVAL_S
from experiments.studies.faults.wrong_worlds.simulated import BODIES, Pushes, Truth, motion_of, scene_of_body
from experiments.studies.grid import command, grid, kept_runs, seeds_of, study_options

PUSHES = {
    "nothing": Pushes(0.0, 0.0),
    "breath 1": Pushes(0.0, 1.0),
    "breath 2": Pushes(0.0, 2.0),
    "breath 4": Pushes(0.0, 4.0),
    "pokes": Pushes(5.0, 0.0),
    "both": Pushes(5.0, 2.0),
}
"""Forces on the body by name. Accelerations [m/s²]: by short forces; by a breath with a period of 3 to 6 s."""

AFTER_S = 1.0
"""Time of the first evaluated frame [s]."""


def run(case: Mapping[str, Any]) -> dict[str, Any]:
    """Do one run, and return its figures.

    A case has the keys `body`, `pushes`, `seed`, `sd_m`, `stated` and `duration_s` [s]. Its marks have noise of the
    standard deviation `sd_m` [m] on each axis; the scene states `stated` times this value.

    frames: number of evaluated frames; lost: number of these frames that are neither TRACKING nor COASTING
    covered: number of frames whose 95 % region contains the truth; wrong: number of frames with a wrong estimate
    nees: mean NEES per dimension; error_mm, sd_mm: root mean square error and standard deviation per axis [mm]
    The figures after `lost` omit the lost frames.
    """
    scene, frames, truth = recorded(case)
    line = Line(scene, baseline=False)
    estimates = [line.take(time_s, marks).estimates[FILTER] for time_s, marks in frames]
    counted = [(place, one) for place, one in zip(truth, estimates, strict=True) if one.time_s >= AFTER_S]
    guiding = [(place, one) for place, one in counted if one.status in (Status.TRACKING, Status.COASTING)]
    found = {"frames": len(counted), "lost": len(counted) - len(guiding)}
    if not guiding:
        return {**found, "wrong": 0, "covered": 0.0, "nees": np.nan, "error_mm": np.nan, "sd_mm": np.nan}
    errors = np.array([place - one.mean for place, one in guiding])
    covs = np.array([one.cov for _, one in guiding])
    dim, nees = errors.shape[1], normalised_error_squared(errors, covs)
    return {
        **found,
        "wrong": sum(is_wrong(one.mean, one.cov, place) for place, one in guiding),
        "covered": float(np.sum(nees <= chi2.ppf(0.95, dim))),
        "nees": float(np.mean(nees) / dim),
        "error_mm": 1e3 * float(np.sqrt(np.mean(errors**2))),
        "sd_mm": 1e3 * float(np.sqrt(np.trace(covs, axis1=1, axis2=2).mean() / dim)),
    }


def recorded(case: Mapping[str, Any]) -> tuple[Scene, Frames, list[Floats]]:
    """The scene of a case, its frames, and the target's true position in each frame [m]; case: see `run`."""
    duration_s, scene = float(case["duration_s"]), scene_of_body(case["body"])
    motion = motion_of(scene, Truth(pushes=PUSHES[case["pushes"]]), case["seed"], duration_s)
    scene = replace(scene, cameras=(), target=replace(scene.target, position_sd_m=0.0))
    network, rng = scene.network, np.random.default_rng([case["seed"], 7])
    times = np.arange(0.0, duration_s, INTERVAL_S)
    places = np.array([motion.at(float(time_s)) for time_s in times])
    seen = places[:, [network.index(node) for node in scene.measured_nodes]]
    seen = seen + case["sd_m"] * rng.normal(size=seen.shape)
    frames = frames_of(times, seen, scene.measured_nodes, case["sd_m"] * case["stated"])
    return scene, frames, list(places[:, network.index(scene.target.node)])


SD_M = (0.3e-3, 1e-3, 4.14e-3, 10e-3, 30e-3)
STATED = (1.0, 10.0, 1.0 / 3.0)
"""Ratios of the stated to the true standard deviation of the marks."""

CELL = ["body", "pushes", "sd_m", "stated"]


def cells_of(runs: pd.DataFrame) -> pd.DataFrame:
    """A row for each case with all its seeds. `covered` and `wrong` are shares of frames, other figures are medians."""
    cells = runs.groupby(CELL, sort=False)
    sums = cells[["frames", "lost", "covered", "wrong"]].sum()
    seen = sums["frames"] - sums["lost"]
    shares = sums[["covered", "wrong"]].div(seen, axis=0)
    medians = cells[["nees", "error_mm", "sd_mm"]].median()
    counts = pd.DataFrame({"seeds": cells.size(), "frames": seen})
    return pd.concat([counts, shares, medians], axis=1).reset_index()


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Do the runs that the output folder lacks, and write cells.csv."""
    parser = study_options(__doc__, seeds=(20, 0))
    parser.add_argument("--bodies", action="append", choices=list(BODIES), help="body; repeat for several")
    parser.add_argument("--pushes", action="append", choices=list(PUSHES), help="push; repeat for several")
    parser.add_argument("--seconds", type=float, default=20.0, help="length of a run [s]: %(default)s")
    given = parser.parse_args(arguments)
    cases = grid(
        seed=seeds_of(given),
        body=given.bodies or BODIES,
        pushes=given.pushes or PUSHES,
        sd_m=SD_M,
        stated=STATED,
        duration_s=[given.seconds],
    )
    cells = cells_of(kept_runs(run, cases, given.out, given).checked())
    write_whole(given.out / "cells.csv", cells.to_csv(index=False))
    sys.stdout.write(cells.to_string(index=False, float_format=lambda x: f"{x:.3g}") + "\n")


if __name__ == "__main__":
    sys.exit(main())
