"""The figures that the settings of the tissue filter serve, from short seeded runs: for a study of settings.

Seeds lie below those that `experiments.studies.estimation.study` reports on.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from estimators import FilterSettings, coverage
from experiments.studies.estimation.trials import Model, Outcome, Trial, run

CAMERAS = {"30fps": (30, 0.00414), "0.3mm": (30, 0.0003), "10fps": (10, 0.00414)}
"""Frames a second and noise of a mark an axis [m]: the paper's camera, a sharp one, a slow one."""

HARD = {
    "missing": Trial("poked", 0, lost=0.3),
    "outliers": Trial("poked", 0, outliers=0.03),
    "hard": Trial("poked", 0, strength=3.0),
}
"""Trials before the first camera, by name."""

DEVELOPMENT_SEEDS = (11, 12, 13)
"""Below 100, where the seeds of the estimation study begin."""


def estimation_figures(
    settings: FilterSettings, seeds: Sequence[int] = DEVELOPMENT_SEEDS, seconds: float = 8.0
) -> dict[str, float]:
    """Mean error [mm] and coverage of the 95 % region, quiet and poked, by camera: `poked_10fps_mm`, `..._coverage`.

    And before the first camera, poked: `poked_missing`, three marks in ten missing; `poked_outliers`, three in a
    hundred misplaced by 30 to 150 mm; `poked_hard`, pokes three times as strong, which the filter does not expect.
    """
    model = Model(settings=settings)
    figures: dict[str, float] = {}
    folder = Path(_truths().name)
    for kind in ("quiet", "poked"):
        for camera, (frames_per_s, sd_m) in CAMERAS.items():
            trial = Trial(kind, 0, seconds, frames_per_s, sd_m)
            runs = [run(replace(trial, seed=seed), model, folder) for seed in seeds]
            figures |= _named(f"{kind}_{camera}", runs)
    for name, trial in HARD.items():
        runs = [run(replace(trial, seed=seed, duration_s=seconds), model, folder) for seed in seeds]
        figures |= _named(f"poked_{name}", runs)
    return figures


@cache
def _truths() -> tempfile.TemporaryDirectory[str]:
    """The folder in which a process keeps the truths of its trials."""
    return tempfile.TemporaryDirectory()


def _named(name: str, runs: Sequence[Outcome]) -> dict[str, float]:
    error_mm = 1e3 * float(np.concatenate([one.filtered for one in runs]).mean())
    return {f"{name}_mm": error_mm, f"{name}_coverage": coverage(np.concatenate([one.nees for one in runs]), 2)}
