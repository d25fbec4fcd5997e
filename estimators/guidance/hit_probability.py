"""Probability that a needle samples a lesion, and the aim with the highest probability.

Target and tip are Gaussian and independent. The position of the tip relative to the target is therefore Gaussian, and
its covariance is the sum of the covariances of target and tip. A linear map turns the lesion into the unit ball. The
squared distance of a point from the centre of this ball is a generalised chi-square variable [imhof1961].
`estimators.guidance.kernels` computes the probability that a point of the needle, or enough of the notch, lies in this
ball. The integral along the needle is a difference of error functions. The integral across it is a Gauss-Legendre sum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from estimators.arrays import Floats
from estimators.guidance.kernels import hit, hit_each
from estimators.guidance.lesion import Lesion
from estimators.guidance.needle import Needle
from estimators.tissue.estimate import GaussianMixture


@dataclass(frozen=True, slots=True, eq=False)
class Aim:
    """Best position of the tip (for `Hit.TIP`) or of the notch's middle [m], (dim,), and hit probability there."""

    point: Floats
    probability: float


def hit_probability(
    target: GaussianMixture, tip: GaussianMixture, axis: Floats, lesion: Lesion, *, needle: Needle | None = None
) -> float:
    """Hit probability: the probability that the lesion contains the part of the needle given by `Needle.hit`.

    The numerical error is below 1e-5. If `Needle.hit` is `Hit.CORE` and the standard deviations along two directions
    differ by a factor of dozens, the numerical error is below 2e-4.

    target: mixture from `TissueFilter.predict_modes`. A single Gaussian would make the result too low for needles that
        are aimed at the target, and too high for needles that are aimed far from it.
    axis: direction in which the needle points [1], (dim,), of any length; the notch lies behind the tip
    Raises ValueError for different dimensions, and for an invalid axis or mixture.
    """
    needle = Needle() if needle is None else needle
    axis = _checked_axis(target, tip, axis, lesion)
    length, core = needle.sampled
    back = needle.reach_m * axis
    offsets = (tip.means - back)[None] - target.means[:, None]
    covs = tip.covs[None] + target.covs[:, None]
    dim, k = lesion.dim, offsets.shape[0] * offsets.shape[1]
    each = hit_each(offsets.reshape(k, dim), covs.reshape(k, dim, dim), axis, lesion.to_ball, length, core)
    # numerical errors of the kernels may raise the sum above one
    return min(float(np.outer(target.weights, tip.weights).ravel() @ each), 1.0)


def best_aim(
    target: GaussianMixture, tip_cov: Floats, axis: Floats, lesion: Lesion, *, needle: Needle | None = None
) -> Aim:
    """The aim with the highest hit probability.

    tip_cov: covariance of the tip [m²], (dim, dim); axis: direction of the needle, (dim,)
    For a Gaussian target, the best aim is the mean, because the set of positions that hit is convex and symmetric
    [anderson1955]. For a mixture, the hit probability may have several maxima. Therefore one search starts from the
    mean of each part, and another from the overall mean. The result is the best aim of all searches.
    """
    needle = Needle() if needle is None else needle
    tip = GaussianMixture.gaussian(target.means[0], tip_cov)
    axis = _checked_axis(target, tip, axis, lesion)
    to_ball, (length, core) = lesion.to_ball, needle.sampled
    covs = target.covs + tip.covs

    def probability(point: Floats) -> float:
        return float(target.weights @ hit_each(point - target.means, covs, axis, to_ball, length, core))

    if len(target.weights) == 1:
        return Aim(target.means[0].copy(), float(hit(np.zeros(lesion.dim), covs[0], axis, to_ball, length, core)))
    scale = float(np.linalg.svd(lesion.axes, compute_uv=False)[-1])
    best = Aim(target.means[0], -1.0)
    for start in (*target.means, target.weights @ target.means):
        simplex = start + np.vstack([np.zeros(lesion.dim), 0.5 * scale * np.eye(lesion.dim)])
        found = minimize(
            lambda point: -probability(point),
            start,
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "xatol": 1e-4 * scale, "fatol": 1e-9},
        )
        if -found.fun > best.probability:
            best = Aim(found.x, float(-found.fun))
    return best


def _checked_axis(target: GaussianMixture, tip: GaussianMixture, axis: Floats, lesion: Lesion) -> Floats:
    """The axis as a unit vector, (dim,); raises ValueError or TypeError for invalid arguments."""
    for name, one in (("target", target), ("tip", tip)):
        if not isinstance(one, GaussianMixture):
            raise TypeError(f"{name}: expected a GaussianMixture, as from predict_modes, found {type(one).__name__}")
        variances = np.einsum("kii->ki", one.covs)
        if not (np.isfinite(one.means).all() and np.isfinite(one.covs).all() and (variances >= 0.0).all()):
            raise ValueError(f"{name}: expected finite means and valid covariances, found {one.means}, {one.covs}")
    dims = (target.means.shape[1], tip.means.shape[1], len(axis))
    if dims != (lesion.dim,) * 3:
        raise ValueError(f"dimensions: expected target, tip and axis of the lesion's {lesion.dim}, found {dims}")
    along = np.asarray(axis, dtype=float)
    length = float(np.linalg.norm(along))
    if not 0.0 < length < np.inf:
        raise ValueError(f"axis: expected a finite non-zero vector, found {along}")
    return along / length
