"""Estimates as rows of estimates.csv: mm, mm², seconds, empty where a method gives none."""

from __future__ import annotations

import numpy as np

from estimators import TargetEstimate

AXES = "xyz"


def header(dim: int) -> list[str]:
    """Names of the columns: the covariance as xx xy yy, then xz yz zz in space."""
    places = [f"{AXES[a]}_mm" for a in range(dim)]
    covs = [AXES[a] + AXES[b] for b in range(dim) for a in range(b + 1)]
    return ["time_s", "status", *places, *covs, "nis", "marks_used", "poked", "gain", "model_only"]


def row(estimate: TargetEstimate) -> list[object]:
    """The values of one estimate under `header`, None where it has none."""
    dim = len(estimate.mean)
    cov = np.full((dim, dim), np.nan) if estimate.cov is None else 1e6 * estimate.cov
    covs = [None if np.isnan(cov[a, b]) else float(cov[a, b]) for b in range(dim) for a in range(b + 1)]
    places = [float(1e3 * x) for x in estimate.mean]
    return [
        estimate.time_s,
        str(estimate.status),
        *places,
        *covs,
        estimate.nis,
        estimate.marks_used,
        estimate.poked,
        estimate.gain,
        estimate.model_only,
    ]
