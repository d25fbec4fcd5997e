"""Estimates as rows of estimates.csv, in mm, mm² and s; missing values are empty."""

from __future__ import annotations

from math import isnan

from estimators import TargetEstimate
from experiments.formats.marks.rows import cov_entries_mm2, cov_names

AXES = "xyz"


def header(dim: int) -> list[str]:
    """Names of the columns of estimates.csv."""
    places = [f"{axis}_mm" for axis in AXES[:dim]]
    return ["time_s", "status", *places, *cov_names(dim), "nis", "marks_used", "poked", "gain", "model_only"]


def row(estimate: TargetEstimate) -> list[object]:
    """The values of one estimate in the order of `header`, None for missing ones."""
    covs: list[float | None] = [None] * len(cov_names(len(estimate.mean)))
    if estimate.cov is not None:
        covs = [None if isnan(entry) else entry for entry in cov_entries_mm2(estimate.cov)]
    return [
        estimate.time_s,
        str(estimate.status),
        *(float(1e3 * x) for x in estimate.mean),
        *covs,
        estimate.nis,
        estimate.marks_used,
        estimate.poked,
        estimate.gain,
        estimate.model_only,
    ]
