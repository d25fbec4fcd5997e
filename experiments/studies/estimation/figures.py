"""The figures that the settings of the tissue filter serve, from short seeded runs: for a study of settings.

Seeds lie below those that `experiments.studies.estimation.study` reports on.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimators import FilterSettings, coverage
from experiments.studies.estimation.trials import Model, Outcome, Trial, run

CAMERAS = {"30fps": (30, 0.00414), "0.3mm": (30, 0.0003), "10fps": (10, 0.00414)}
"""Frames a second and noise of a mark an axis [m]: the paper's camera, a sharp one, a slow one."""

DEVELOPMENT_SEEDS = (11, 12, 13)
"""Below 100, where the seeds of the estimation study begin."""


def estimation_figures(
    settings: FilterSettings, seeds: Sequence[int] = DEVELOPMENT_SEEDS, seconds: float = 10.0
) -> dict[str, float]:
    """Mean error [mm] and coverage of the 95 % region, quiet and poked, by camera: `poked_10fps_mm`, `..._coverage`.

    And `poked_missing`: poked before the first camera, three marks in ten missing.
    """
    model = Model(settings=settings)
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for kind in ("quiet", "poked"):
            for camera, (frames_per_s, sd_m) in CAMERAS.items():
                trial = Trial(kind, 0, seconds, frames_per_s, sd_m)
                runs = [run(replace(trial, seed=seed), model, Path(folder)) for seed in seeds]
                figures |= _named(f"{kind}_{camera}", runs)
        trial = Trial("poked", 0, seconds, lost=0.3)
        figures |= _named("poked_missing", [run(replace(trial, seed=seed), model, Path(folder)) for seed in seeds])
    return figures


def _named(name: str, runs: Sequence[Outcome]) -> dict[str, float]:
    error_mm = 1e3 * float(np.concatenate([one.filtered for one in runs]).mean())
    return {f"{name}_mm": error_mm, f"{name}_coverage": coverage(np.concatenate([one.nees for one in runs]), 2)}
