"""Registration: estimation of the rigid motion from points in a body's own coordinates to measured points.

The motion has the largest likelihood under independent Gaussian errors of the measured points, each with its own
covariance. Newton's method starts from the rotation of [kabsch1976]. Where chi-square is not convex, a Gauss-Newton
step replaces the Newton step. The covariance of the motion follows from a linearisation. In the terms of
[fitzpatrick1998], residuals are fiducial registration errors, and `Registration.error_cov` is the covariance of target
registration errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from estimators.arrays import Floats
from estimators.pose.rigid import GENERATORS, RigidMotion

LARGEST_RAD = 0.2
"""Largest standard deviation of the rotation about any axis [rad]; choice: above it, linearisation is inaccurate."""

LEAST_M = 1e-9
"""Size of measured points below which they count as one place or line [m]; choice: the resolution of files."""

ITERATIONS, CONVERGED = 100, 1e-12
"""Largest number of Newton steps, and value of `step' A step / (1 + chi_square)` below which they end [1]; numerical.
The vector `step` is a change of the motion, and A is the information matrix of the motion."""

ROUNDING = 1e-9
"""Largest relative increase of chi-square by a rounding error. After a larger increase, a step is halved; numerical."""


class RegistrationError(ValueError):
    """Error for points that do not determine a rigid motion."""


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """Rigid motion fitted to measured points.

    motion: motion from the body's own coordinates to the coordinates of the measured points
    cov: covariance of the error of translation [m] and rotation [rad], (n, n)
    residuals: measured minus moved points [m], (k, dim)
    residual_covs: covariance of each residual [m²], (k, dim, dim), calculated from the covariances of the points
    chi_square: sum of the squared residuals, normalised by the points' covariances [1]
    """

    motion: RigidMotion
    cov: Floats
    residuals: Floats
    residual_covs: Floats
    chi_square: float

    @property
    def degrees(self) -> int:
        """Degrees of freedom of `chi_square`."""
        return self.residuals.size - len(self.cov)

    @property
    def p_value(self) -> float:
        """P-value of `chi_square`: probability of a value at least as large if the stated covariances are right."""
        return float(chi2.sf(self.chi_square, self.degrees))

    @property
    def rms_m(self) -> float:
        """Root mean square of the residuals [m]."""
        return float(np.sqrt(np.mean(np.sum(self.residuals**2, axis=1))))

    @property
    def expected_rms_m(self) -> float:
        """Expected root mean square of the residuals [m], from the stated covariances."""
        return float(np.sqrt(np.trace(self.residual_covs, axis1=1, axis2=2).mean()))

    def error_cov(self, drawn: Floats) -> Floats:
        """Covariance of the registration error [m²], (k, dim, dim), at body points `drawn` [m], (k, dim)."""
        J = self.motion.change_of(self.motion.moved(drawn))
        return np.asarray(J @ self.cov @ J.transpose(0, 2, 1))


def weighted_mean(places: Floats, covs: Floats) -> tuple[Floats, Floats]:
    """Weighted mean of independent measurements of one position.

    places: measured positions [m], (k, dim); covs: their covariances [m²], (k, dim, dim)
    Returns the mean [m], (dim,), and its covariance [m²], (dim, dim).
    """
    information = np.linalg.inv(covs)
    cov = np.linalg.inv(information.sum(axis=0))
    return cov @ np.einsum("kij,kj->i", information, places), cov


def register_points(drawn: Floats, measured: Floats, covs: Floats) -> Registration:
    """The most probable rigid motion, without scale or reflection, from points of a body to measured points.

    Parameters
    ----------
    drawn : (k, dim)
        Positions of the points in the body's own coordinates [m].
    measured : (k, dim)
        Positions of the same points in the coordinates of the tracker [m].
    covs : (k, dim, dim)
        Covariances of the measured positions [m²]. Errors of different points are independent.

    Returns
    -------
    Registration

    Raises
    ------
    RegistrationError
        If there are fewer than two points in the plane, or fewer than three points in space, or if the standard
        deviation of the rotation exceeds `LARGEST_RAD`, for example because the points are close to a line, or if the
        measured points lie at one place, or in space on one line.
    ValueError
        If shapes do not match, or if a number is not finite.

    References
    ----------
    [kabsch1976], [fitzpatrick1998]
    """
    drawn, measured, covs = (np.asarray(each, dtype=float) for each in (drawn, measured, covs))
    n_points, dim = len(drawn), drawn.shape[-1]
    least = f"{dim} or more points far from {'each other' if dim == 2 else 'one line'}"
    if n_points < dim:
        raise RegistrationError(f"expected {least}, found {n_points}")
    shapes = drawn.shape, measured.shape, covs.shape
    if dim not in (2, 3) or shapes != (expected := (n_points, dim), expected, (*expected, dim)):
        raise ValueError(f"points: expected shapes (k, dim), (k, dim) and (k, dim, dim), found {shapes}")
    if not all(np.isfinite(each).all() for each in (drawn, measured, covs)):
        raise ValueError("points: expected finite numbers, found others")
    if np.linalg.matrix_rank(measured - measured.mean(axis=0), tol=LEAST_M) < dim - 1:
        where = "at one place" if dim == 2 else "on one line"
        raise RegistrationError(f"expected {least}, found {n_points} measured {where}")
    whitening = np.linalg.inv(np.linalg.cholesky(covs))
    motion = _kabsch(drawn, measured, 1.0 / np.trace(covs, axis1=1, axis2=2))
    for _ in range(ITERATIONS):
        moved = motion.moved(drawn)
        r = np.einsum("kij,kj->ki", whitening, measured - moved).ravel()
        J = (whitening @ motion.change_of(moved)).reshape(len(r), -1)
        A = J.T @ J
        if (sd_rad := _turn_sd(A, dim)) > LARGEST_RAD:
            uncertain = f"{n_points} that leave the turn uncertain by {sd_rad:.2g} rad"
            raise RegistrationError(f"expected {least}, found {uncertain}")
        H = _hessian(A, motion, moved, np.einsum("kji,kj->ki", whitening, r.reshape(-1, dim)))
        step = np.linalg.solve(H if np.linalg.eigvalsh(H)[0] > 0.0 else A, J.T @ r)
        if step @ A @ step < CONVERGED * (1.0 + r @ r):
            break
        while _chi_square(motion.changed(step), drawn, measured, whitening) > (1.0 + ROUNDING) * (r @ r):
            step = 0.5 * step
        motion = motion.changed(step)
    else:
        raise RegistrationError("expected points that lie as drawn, found a fit that does not converge")
    cov, effect = np.asarray(np.linalg.inv(A)), motion.change_of(moved)
    residual_covs = covs - effect @ cov @ effect.transpose(0, 2, 1)
    return Registration(motion, cov, measured - moved, residual_covs, float(r @ r))


def without_each(drawn: Floats, measured: Floats, covs: Floats) -> tuple[Registration | None, ...]:
    """For each of k points: registration from all other points, or None if these do not determine a motion.

    drawn, measured: positions of the points [m], (k, dim)
    covs: covariances of the measured positions [m²], (k, dim, dim)
    """
    found: list[Registration | None] = []
    for k in range(len(drawn)):
        others = np.arange(len(drawn)) != k
        try:
            found.append(register_points(drawn[others], measured[others], covs[others]))
        except RegistrationError:
            found.append(None)
    return tuple(found)


def _kabsch(drawn: Floats, measured: Floats, weights: Floats) -> RigidMotion:
    """Rigid motion with the smallest weighted sum of squared residuals; weights: (k,). Source: [kabsch1976]."""
    centre, middle = (np.average(places, axis=0, weights=weights) for places in (drawn, measured))
    left, _, right = np.linalg.svd((measured - middle).T @ (weights[:, None] * (drawn - centre)))
    left[:, -1] *= np.sign(np.linalg.det(left @ right))
    return RigidMotion(left @ right, middle - centre, centre)


def _turn_sd(A: Floats, dim: int) -> float:
    """Largest standard deviation of the rotation [rad], from an information matrix A (n, n); inf if undetermined."""
    of_turn = A[dim:, dim:] - A[dim:, :dim] @ np.linalg.solve(A[:dim, :dim], A[:dim, dim:])
    least = float(np.linalg.eigvalsh(of_turn)[0])
    return 1.0 / np.sqrt(least) if least > 0.0 else np.inf


def _hessian(A: Floats, motion: RigidMotion, moved: Floats, pulls: Floats) -> Floats:
    """Half the second derivative of chi-square with respect to a change of the motion, (n, n).

    A: Gauss-Newton approximation of the result, (n, n); moved: moved points, (k, dim)
    pulls: inverse covariance times residual of each point, (k, dim)
    """
    dim, H = moved.shape[1], A.copy()
    G = GENERATORS[dim]
    curved = np.einsum("ki,aij,bjl,kl->ab", pulls, G, G, moved - motion.centre - motion.translation)
    H[dim:, dim:] -= 0.5 * (curved + curved.T)
    return H


def _chi_square(motion: RigidMotion, drawn: Floats, measured: Floats, whitening: Floats) -> float:
    return float(np.sum(np.einsum("kij,kj->ki", whitening, measured - motion.moved(drawn)) ** 2))
