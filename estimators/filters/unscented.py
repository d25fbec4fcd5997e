"""filterpy's unscented filter with compiled loops, batches of sigma points, and measurements of any length."""

from __future__ import annotations

from collections.abc import Callable

import filterpy.kalman as filterpy
import numpy as np

from estimators.arrays import Floats
from estimators.filters.kernels import moments, symmetric_points


class CovarianceError(ArithmeticError):
    """Error for a covariance that is not positive definite."""


def positive_points(n: int) -> filterpy.MerweScaledSigmaPoints:
    """Sigma points with positive weights only: alpha 1, beta 0, kappa 0, which is the third-degree cubature rule.

    With the common choice kappa = 3 - n and more than three states, the weight of the centre is negative. The
    covariance may then become indefinite [arasaratnam2009].
    """
    return filterpy.MerweScaledSigmaPoints(n, alpha=1.0, beta=0.0, kappa=0.0)


class UnscentedKalmanFilter(filterpy.UnscentedKalmanFilter):
    """Unscented Kalman filter with filterpy's fields (x, P, Q, R, K, S, y), and these differences.

    - fx(points, dt) and hx(points) take all sigma points at once, (n_points, dim_x), and return a row for each;
    - the length of a measurement may change between updates, if hx and R change with it;
    - P is exactly symmetric, and a P or S that is not positive definite raises CovarianceError;
    - the likelihood is stored as a logarithm, so that it cannot underflow.

    State: x (dim_x,) and P (dim_x, dim_x) after the last predict or update; nis and log_likelihood of the last update.
    """

    def __init__(
        self,
        dim_x: int,
        fx: Callable[[Floats, float], Floats],
        hx: Callable[[Floats], Floats] | None = None,
        points: filterpy.MerweScaledSigmaPoints | None = None,
    ) -> None:
        points = positive_points(dim_x) if points is None else points
        super().__init__(dim_x, dim_z=1, dt=0.0, hx=hx, fx=fx, points=points)
        self._scale = points.alpha**2 * (points.n + points.kappa)
        self.nis = 0.0

    def predict(self, dt: float) -> None:
        """Predict x and P over dt [s] with the process noise Q. Raises CovarianceError."""
        points = self.fx(self._drawn(), dt)
        self.x, self.P = moments(points, self.Wm, self.Wc, self.Q)

    def update(self, z: Floats | None, R: Floats | None = None, hx: Callable[[Floats], Floats] | None = None) -> None:
        """Update with a measurement z (m,) and its noise covariance R (m, m), unless z is None. Raises CovarianceError.

        hx: function from sigma points (n_points, dim_x) to measurements (n_points, m)
        """
        if z is None:
            return
        R = self.R if R is None else R
        drawn = self._drawn()
        seen = np.ascontiguousarray((self.hx if hx is None else hx)(drawn))
        expected, S = moments(seen, self.Wm, self.Wc, R)
        cross = (self.Wc[:, None] * (drawn - self.x)).T @ (seen - expected)
        y = z - expected
        try:
            C = np.linalg.cholesky(S)
        except np.linalg.LinAlgError:
            raise CovarianceError("innovation covariance: expected a positive definite matrix, found another") from None
        K = np.linalg.solve(C.T, np.linalg.solve(C, cross.T)).T
        updated = self.P - K @ S @ K.T
        w = np.linalg.solve(C, y)
        self._accept(self.x + K @ y, 0.5 * (updated + updated.T), (y, S, K))
        self._judge(float(w @ w), float(2.0 * np.log(np.diag(C)).sum()))

    def _drawn(self) -> Floats:
        points, definite = symmetric_points(self.x, self.P, self._scale)
        if not definite:
            raise CovarianceError("state covariance: expected a positive definite matrix, found another")
        return points

    def _accept(self, x: Floats, P: Floats, solved: tuple[Floats, Floats, Floats]) -> None:
        self.x, self.P = x, P
        self.y, self.S, self.K = solved

    def _judge(self, nis: float, log_det: float) -> None:
        self.nis = nis
        self._log_likelihood = -0.5 * (nis + log_det + len(self.y) * np.log(2.0 * np.pi))
        self._likelihood = None
        self._mahalanobis = np.sqrt(nis)
