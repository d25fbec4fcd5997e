"""filterpy's unscented Kalman filter, applied to the tissue without changes."""

from __future__ import annotations

import filterpy.kalman as filterpy
import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats
from estimators.baselines.baseline import Baseline

ALPHA, BETA = 0.1, 2.0
"""Parameters of the sigma points. With `kappa = 3 - dim_x`, filterpy's documentation [labbe2015] recommends them."""


class StockUnscented(Baseline):
    """filterpy's UnscentedKalmanFilter without changes. It assumes at all times that short forces (pokes) act.

    Sigma points are drawn once per frame and move in steps of at most 1/120 s. Process noise is added once per frame,
    as if there were no springs, see `TissueModel.noise`. The other methods add process noise at each step. This
    difference is small at 30 frames/s, but dominates at 10 frames/s or less.

    State: filter, the object from filterpy; restarts, how often the filter restarted because its covariance was not
        positive definite; and the state of `Baseline`.
    """

    filter: filterpy.UnscentedKalmanFilter
    restarts = 0

    def _start(self, mean: Floats, cov: Floats) -> None:
        self._first = mean.copy(), cov.copy()
        n = self.model.dim_x
        points = filterpy.MerweScaledSigmaPoints(n, alpha=ALPHA, beta=BETA, kappa=3.0 - n)
        self.filter = filterpy.UnscentedKalmanFilter(n, dim_z=1, dt=0.0, hx=None, fx=self._moved, points=points)
        self.filter.x, self.filter.P = mean, cov
        self._draw()

    def _moved(self, point: Floats, dt: float) -> Floats:
        return self.model.propagate(point[None], dt, self.settings.poked)[0]

    def _draw(self) -> None:
        # filterpy draws points only in predict; a further update at the same time needs new points
        try:
            self.filter.compute_process_sigmas(0.0, fx=lambda point, _dt: point)
        except np.linalg.LinAlgError:
            self.restarts += 1
            self._start(*self._first)

    def _advance(self, dt: float) -> None:
        self.filter.Q = self.model.noise(dt, self.settings.poked)
        try:
            self.filter.predict(dt)
        except np.linalg.LinAlgError:
            self.restarts += 1
            self._start(*self._first)

    def _take(self, z: Floats, rows: NDArray[np.int64], R: Floats) -> float:
        self.filter.update(z, R=R, hx=lambda point: point[rows])
        self._draw()
        return float(self.filter.y @ self.filter.SI @ self.filter.y)

    def _moments(self) -> tuple[Floats, Floats]:
        return self.filter.x, self.filter.P
