"""Scores of estimates of hidden nodes against the truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators import coverage, normalised_error_squared
from experiments.arrays import Floats

SIGMAS, SHARE_OF_SIZE = 5.0, 0.1
"""TRACKING is wrong where the error is both beyond so many sigma and beyond this share of the body's size."""


def mean_distance(places: Floats, truth: Floats) -> float:
    """Mean distance of places from the truth [m], each (..., dim); infinite where a place is not finite."""
    if not np.isfinite(places).all():
        return float("inf")
    return float(np.linalg.norm(places - truth, axis=-1).mean())


def hidden_scores(
    means: Floats, covs: Floats, truth: Floats, *, tracking: NDArray[np.bool_], size_m: float
) -> dict[str, float | int]:
    """Figures of all hidden nodes in all frames together.

    means, truth [m], (n_frames, n_hidden, dim); covs [m²], (n_frames, n_hidden, dim, dim); tracking: (n_frames,)
    non_finite: estimates that are not finite or whose covariance is not positive definite; they are left out of the
    other figures, but for `error_m`, which is then infinite
    wrong_tracking: frames TRACKING with a node beyond five sigma and beyond a tenth of the body's size
    """
    dim = truth.shape[-1]
    errors = (means - truth).reshape(-1, dim)
    flat = covs.reshape(-1, dim, dim)
    finite = np.asarray(np.isfinite(errors).all(axis=1) & np.isfinite(flat).all(axis=(1, 2)))
    good = np.zeros(len(errors), dtype=bool)
    good[finite] = np.linalg.eigvalsh(flat[finite])[:, 0] > 0.0
    nees = np.full(len(errors), np.inf)
    nees[good] = normalised_error_squared(errors[good], flat[good])
    distance = np.full(len(errors), np.inf)
    distance[finite] = np.linalg.norm(errors[finite], axis=1)
    wrong = (nees > SIGMAS**2) & (distance > SHARE_OF_SIZE * size_m)
    by_frame = wrong.reshape(truth.shape[:2]).any(axis=1)
    return {
        "error_m": float(distance.mean()),
        "rms_m": float(np.sqrt((distance**2).mean())),
        "worst_m": float(distance.max()),
        "covered": coverage(nees, dim),
        "nees": float(nees[good].mean() / dim) if good.any() else float("inf"),
        "sigma_m": float(np.sqrt(np.trace(flat[good], axis1=1, axis2=2).mean())) if good.any() else float("inf"),
        "non_finite": int((~good).sum()),
        "wrong_tracking": int((by_frame & tracking).sum()),
    }
