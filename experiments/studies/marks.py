"""Accuracy of mark detection in synthetic frames with known truth, in good light and in all simulated rooms.

    python -m experiments.studies.marks --out study      # some ten minutes on two cores
    python -m experiments.studies.marks --runs 4 --frames 20 --out study

Each run has its own camera, lamps, surface and motion (`vision.drawn_run`); hues are learned from one click; expected
positions have an error of 3 px on each axis. A mark counts as visible if more than half of its area is; a detection is
false if it is farther from its mark's centre than the mark's radius. Latest figures: docs/marks-study.md.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
import pandas as pd

from experiments.engine.runs import Case
from experiments.engine.workers import chosen_workers
from experiments.studies.grid import add_seeds, command, grid, kept_runs, print_figures, seeds_of, study_options
from vision import (
    Expected,
    HueError,
    Lens,
    Level,
    MarkFinder,
    Outline,
    Pose,
    learn_hue,
    posed_camera,
    synthetic_run,
)
from vision.tracking.settings import FINDER

LEVELS: tuple[Level, ...] = ("good light", "whole range")
FIRST_SEED = 10_000
"""First seed of the study; smaller seeds were used for choices."""
VISIBLE = 0.5
"""Least visible share of a mark with which it counts as visible."""
FAR_PX = 4.0
"""Distance from the true position above which a detection counts as far [px]; it also counts for the errors."""
PREDICTED_SD_PX = 3.0
"""Error of a mark's predicted position on each axis [px]; that of the tissue filter is smaller at 1 mm per pixel."""


def run(case: Case) -> list[dict[str, object]]:
    """A row for each mark and frame: visible, found, error du dv [px], covariance uu vv [px²], right name."""
    frames = iter(synthetic_run(case["seed"], case["n_frames"], case["level"]))
    first = next(frames)
    view, radius_m = first.camera.view, first.marks[0].radius_m
    lens = Lens(view.matrix, np.array(view.distortion))
    camera = posed_camera("drawn", view.size_px, lens, Pose(view.rotation, view.translation_m))
    names = [f"M{k}" for k in range(len(first.marks))]
    clearest = int(np.argmax(first.frame.visible))
    hue = learn_hue(first.frame.image, first.frame.centers_px[clearest], FINDER.hue.learning)
    finder = MarkFinder([hue])
    rng = np.random.default_rng([case["seed"], 7])
    gate = PREDICTED_SD_PX**2 * np.eye(2)

    rows: list[dict[str, object]] = []
    for one in (first, *frames):
        expected = []
        for name, truth in zip(names, one.frame.centers_px, strict=True):
            place = truth + rng.normal(0.0, PREDICTED_SD_PX, 2)
            at = camera.to_plane(np.clip(place, 0.0, np.array(view.size_px) - 1.0))[0]
            outline = Outline(camera.disc_shape(at, radius_m), 0.05)
            expected.append(Expected(name, place, gate, hue.hue_deg, outline))
        radius_px = [float(np.sqrt(one.outline.area_px / np.pi)) for one in expected if one.outline is not None]
        try:
            found = {f.name: f.detection for f in finder.find(one.frame.image, expected)}
        except HueError:
            # the hue learned from one click also selects the background; a user would be asked for another position
            found = {}
        for k, name in enumerate(names):
            truth = one.frame.centers_px[k]
            row: dict[str, object] = {"frame": one.index, "mark": name}
            row |= {"visible": float(one.frame.visible[k]), "found": name in found}
            if name in found:
                seen = found[name]
                center = seen.center_px - camera.disc_shift(camera.to_plane(seen.center_px), radius_m)[0]
                away_px = float(np.linalg.norm(truth - center))
                row |= {"du": center[0] - truth[0], "dv": center[1] - truth[1]}
                row |= {"uu": seen.cov_px2[0, 0], "vv": seen.cov_px2[1, 1]}
                row |= {"far": away_px > FAR_PX, "false": away_px > radius_px[k]}
            rows.append(row)
    return rows


def figures(rows: pd.DataFrame) -> dict[str, float]:
    """Figures of all rows with the same level, one of `LEVELS`."""
    visible = rows[rows.visible > VISIBLE]
    seen = visible[visible.found.astype(bool)]
    right = seen[~seen.false.astype(bool)]
    errors = right[["du", "dv"]].to_numpy(dtype=float)
    variance = right[["uu", "vv"]].to_numpy(dtype=float)
    named = rows[rows.found.astype(bool)]
    n_frames = len(rows.drop_duplicates(["seed", "frame"]))
    return {
        "frames": n_frames,
        "marks_visible": len(visible),
        "found": len(right) / len(visible),
        "rms_px": float(np.sqrt((errors**2).mean())),
        "predicted_by_real": float(np.sqrt(variance.mean() / (errors**2).mean())),
        "false_per_1000_frames": 1000.0 * float(named.false.astype(bool).sum()) / n_frames,
        "far_per_1000_frames": 1000.0 * float(named.far.astype(bool).sum()) / n_frames,
    }


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study and print its figures."""
    parser = study_options(__doc__)
    parser.add_argument("--frames", type=int, default=60)
    add_seeds(parser, 100, FIRST_SEED, runs="--runs")
    given = parser.parse_args(arguments)
    cases = grid(level=LEVELS, seed=seeds_of(given), n_frames=[given.frames])
    for level, rows in kept_runs(run, cases, given.out, chosen_workers(given)).groupby("level", sort=False):
        print_figures(f"{level}: ", figures(rows), digits=4)


if __name__ == "__main__":
    sys.exit(main())
