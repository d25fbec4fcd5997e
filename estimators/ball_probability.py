"""Probability that a Gaussian point lies in a ball, for many Gaussians at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

Floats = NDArray[np.float64]

POINTS = np.polynomial.legendre.leggauss(48)
"""Nodes and weights on (-1, 1), for each axis but the narrowest, which is summed in closed form; chosen."""

REACH = 8.5
"""Standard deviations beyond which a Gaussian is nothing in double precision."""


def ball_probability(mean_offsets: ArrayLike, covs: ArrayLike, radius: float) -> Floats:
    """Probability that |offset + noise| is at most the radius [m], (n,).

    mean_offsets: [m], (n, dim), dim 2 or 3; covs: of the noise [m²], (n, dim, dim), positive definite, else ValueError
    In the axes of each covariance: Gauss-Legendre over the wide ones, as angles, the normal distribution function over
    the narrowest. Good to 1e-6 while the axes differ by less than ten to one.
    """
    m, P = np.asarray(mean_offsets, dtype=float), np.asarray(covs, dtype=float)
    if m.ndim != 2 or m.shape[1] not in (2, 3) or P.shape != (*m.shape, m.shape[1]):
        raise ValueError(f"expected offsets (n, 2) or (n, 3) and covs (n, dim, dim), found {m.shape} and {P.shape}")
    variances, axes = np.linalg.eigh(P)
    if not (variances > 0.0).all():
        raise ValueError(f"covs: expected positive definite ones, found an eigenvalue of {variances.min():.3g} m²")
    along = np.einsum("nij,ni->nj", axes, m)[:, ::-1]
    sds = np.sqrt(variances)[:, ::-1]
    inside = _sliced(along, sds, np.full(len(m), float(radius)))
    return np.clip(inside, 0.0, 1.0)


def _sliced(means: Floats, sds: Floats, radii: Floats) -> Floats:
    """Probability of balls of the radii (...) for independent coordinates, (..., dim), the widest first."""
    if means.shape[-1] == 1:
        mean, sd = means[..., 0], sds[..., 0]
        return np.asarray(ndtr((radii - mean) / sd) - ndtr((-radii - mean) / sd))
    mean, sd, r = means[..., :1], sds[..., :1], radii[..., None]
    # x = r sin(angle), and the slice there is a ball of radius r cos(angle); only where the Gaussian is
    edges = np.arcsin(np.clip((mean + np.array([-REACH, REACH]) * sd) / r, -1.0, 1.0))
    half = 0.5 * (edges[..., 1:] - edges[..., :1])
    angle = edges[..., :1] + half * (POINTS[0] + 1.0)
    x, slices = r * np.sin(angle), r * np.cos(angle)
    density = np.exp(-0.5 * ((x - mean) / sd) ** 2) / (np.sqrt(2.0 * np.pi) * sd)
    shape = (*slices.shape, means.shape[-1] - 1)
    rest = _sliced(np.broadcast_to(means[..., None, 1:], shape), np.broadcast_to(sds[..., None, 1:], shape), slices)
    return np.asarray((half * POINTS[1] * density * slices * rest).sum(axis=-1))
