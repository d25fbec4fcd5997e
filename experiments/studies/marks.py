"""Accuracy of mark detection in synthetic frames with known truth: in good light, and with simulated disturbances.

    python -m experiments.studies.marks --out study      # some ten minutes on two cores
    python -m experiments.studies.marks --runs 4 --frames 20 --out study

Camera, lamps, surface and motion differ from run to run (`vision.synthetic_run`). The hue is learned from one mark in
the first frame. Expected positions of marks have an error of 3 px on each axis. Only marks with more than half of their
area visible count as visible. A detection is false if it is more than a radius away from the centre of its mark.
study/marks.json has the figures of docs/marks-study.md; study/marks.csv has a row for each mark in each frame.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence

import numpy as np
import pandas as pd

from experiments.engine.runs import Case
from experiments.engine.study import OWN
from experiments.formats.outputs import write_whole
from experiments.studies.grid import command, grid, kept_runs, print_figures, runs_of, seeds_of, study_options
from experiments.studies.real_balls import PxFollower
from vision import (
    Disc,
    Expected,
    Frame,
    HueError,
    Lens,
    Level,
    Lighting,
    MarkFinder,
    MarkHue,
    Outline,
    Pose,
    draw_frame,
    learn_hue,
    posed_camera,
    synthetic_run,
)
from vision.tracking.settings import FINDER

LEVELS: tuple[Level, ...] = ("good light", "whole range")
FIRST_SEED = 10_000
"""First seed of the study. Settings were chosen with smaller seeds."""
VISIBLE = 0.5
"""A mark counts as visible if more than this share of its area is visible."""
FAR_PX = 4.0
"""A detection with a larger error than this [px] counts as far. The rms error includes far detections."""
PREDICTED_SD_PX = 3.0
"""Standard deviation of a mark's expected position on each axis [px]. At 1 mm/px, that of `TissueFilter` is smaller."""


def run(case: Case) -> list[dict[str, object]]:
    """A row for each mark and frame of a run: error of the detection [px], and variances of the detection [px²]."""
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
            visible = float(one.frame.visible[k])
            row: dict[str, object] = {"frame": one.index, "mark": name, "visible": visible, "found": name in found}
            if name in found:
                seen = found[name]
                center = seen.center_px - camera.disc_shift(camera.to_plane(seen.center_px), radius_m)[0]
                away = np.linalg.norm(one.frame.centers_px - center, axis=1)
                false = bool(away[k] > radius_px[k])
                row |= {"du": center[0] - truth[0], "dv": center[1] - truth[1]}
                row |= {"uu": seen.cov_px2[0, 0], "vv": seen.cov_px2[1, 1], "occluded": seen.occluded}
                row |= {"far": bool(away[k] > FAR_PX), "false": false}
                row |= {"swapped": false and bool((away < radius_px).any())}
            rows.append(row)
    return rows


def figures(rows: pd.DataFrame) -> dict[str, float]:
    """Figures of detection, from the rows of one of `LEVELS`."""
    visible, named = rows[rows.visible > VISIBLE], rows[rows.found.astype(bool)]
    seen = named[named.visible > VISIBLE]
    right = seen[~seen.false.astype(bool)]
    errors, variance = (right[columns].to_numpy(dtype=float) for columns in (["du", "dv"], ["uu", "vv"]))
    n_frames = len(rows.drop_duplicates(["seed", "frame"]))
    return {
        "frames": n_frames,
        "marks_visible": len(visible),
        "found": len(right) / len(visible),
        "rms_px": float(np.sqrt((errors**2).mean())),
        "median_px": float(np.median(np.hypot(*errors.T))),
        "predicted_by_real": float(np.sqrt(variance.mean() / (errors**2).mean())),
        "false_per_1000_frames": 1000.0 * float(named.false.astype(bool).sum()) / n_frames,
        "far_per_1000_frames": 1000.0 * float(named.far.astype(bool).sum()) / n_frames,
        "swapped": int(named.swapped.astype(bool).sum()),
    }


def crossing(seed: int, n_frames: int = 50) -> tuple[int, int]:
    """Follow two marks of one hue that cross and touch; their relative speed is 2 px per frame or more.

    A filter with constant velocity predicts each mark. A detection counts as an exchange if it is nearer to the
    true position of the other mark while the marks do not touch. Returns the numbers of exchanges and of frames.
    """
    rng = np.random.default_rng([seed, 9])
    radius, middle = rng.uniform(7.0, 12.0), np.array([140.0, 110.0])
    angles = rng.uniform(0.0, 2.0 * np.pi) + np.array([0.0, rng.uniform(0.5, 2.0 * np.pi - 0.5)])
    speeds = rng.uniform(1.5, 5.0, 2)
    ways = speeds[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    # slower marks would touch from the first frame to the last
    ways *= max(1.0, 2.0 / np.hypot(*(ways[0] - ways[1])))
    miss = rng.uniform(-1.5, 1.5, (2, 2)) * radius / 2.0
    times = np.arange(n_frames) - n_frames / 2.0
    hue, outline = MarkHue(0.0), Outline(radius * np.eye(2), 0.05)
    places = middle + miss[:, None] + times[None, :, None] * ways[:, None]
    follower = PxFollower({"a": hue, "b": hue}, 60.0, {"a": places[0, 0], "b": places[1, 0]})
    lost = 0
    for k in range(n_frames):
        discs = [Disc(place, (radius, radius), 0.0) for place in places[:, k]]
        frame = Frame(k, k / 30.0, draw_frame((280, 220), discs, Lighting(), rng))
        found = follower.see(frame, {"a": outline, "b": outline})
        apart = float(np.hypot(*(places[0, k] - places[1, k])))
        for own, name in enumerate(("a", "b")):
            if name in found and apart > 2.0 * radius:
                distances = np.linalg.norm(places[:, k] - found[name].center_px, axis=1)
                lost += int(distances[own] > distances[1 - own])
    return lost, n_frames


def crossings(n_runs: int, given: argparse.Namespace) -> dict[str, float]:
    """Numbers of frames, of exchanges, and of runs with an exchange, in `n_runs` runs of `crossing`."""
    lost, frames = np.array(runs_of(crossing, range(n_runs), given)).T
    return {"frames": int(frames.sum()), "frames_lost": int(lost.sum()), "crossings_swapped": int((lost > 0).sum())}


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Run each seed with both of `LEVELS`. Write and print the figures."""
    parser = study_options(__doc__, seeds=(100, FIRST_SEED), runs="--runs")
    parser.add_argument("--frames", type=int, default=60)
    given = parser.parse_args(arguments)
    cases = grid(level=LEVELS, seed=seeds_of(given), n_frames=[given.frames])
    table = kept_runs(run, cases, given.out / "runs", given).checked()
    table = table.drop(columns=["n_frames", *OWN])
    table.insert(len(table.columns) - 1, "level", table.pop("level"))
    by_level: dict[str, dict[str, float]] = {level: figures(table[table.level == level]) for level in LEVELS}
    by_level |= {"crossings": crossings(5 * given.n_seeds, given)}
    write_whole(given.out / "marks.csv", table.to_csv(index=False, float_format="%.4f"))
    write_whole(given.out / "marks.json", json.dumps(by_level, indent=1) + "\n")
    for level, row in by_level.items():
        print_figures(f"{level}: ", row, digits=4)


if __name__ == "__main__":
    sys.exit(main())
