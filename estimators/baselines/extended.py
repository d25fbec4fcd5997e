"""Extended Kalman filter of the tissue."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats
from estimators.baselines.baseline import Baseline
from estimators.consistency.joseph import joseph_update
from estimators.filters.unscented import CovarianceError
from estimators.process.process_model import ForceMode, TissueModel

DIFFERENCE = 1e-6
"""Half-width of central differences [m, m/s, N]: much smaller than the slip velocity of friction, 5e-3 m/s."""


def transition(model: TissueModel, x: Floats, dt: float, mode: ForceMode) -> tuple[Floats, Floats]:
    """State after dt [s] from a state x (dim_x,), and its Jacobian by central differences, (dim_x, dim_x)."""
    n = len(x)
    offsets = DIFFERENCE * np.eye(n)
    moved = model.propagate(np.vstack([x[None], x + offsets, x - offsets]), dt, mode)
    return moved[0], (moved[1 : n + 1] - moved[n + 1 :]).T / (2.0 * DIFFERENCE)


class ExtendedKalmanFilter(Baseline):
    """Extended Kalman filter that assumes at all times that short forces (pokes) act.

    The motion is linearised at each step of at most 1/120 s. The update uses Joseph's form of the covariance. Source:
    [barshalom2001], section 10.3.

    State: x (dim_x,) and P (dim_x, dim_x), besides the state of `Baseline`.
    """

    x: Floats
    P: Floats

    def _start(self, mean: Floats, cov: Floats) -> None:
        self.x, self.P = mean, cov

    def _advance(self, dt: float) -> None:
        mode = self.settings.poked
        n = self.model.stepper.n_steps(dt)
        Q = self.model.noise(dt / n, mode)
        for _ in range(n):
            self.x, F = transition(self.model, self.x, dt / n, mode)
            P = F @ self.P @ F.T + Q
            self.P = 0.5 * (P + P.T)

    def _take(self, z: Floats, rows: NDArray[np.int64], R: Floats) -> float:
        H = np.eye(self.model.dim_x)[rows]
        x, P, _y, _S, _K, nis, _log_det, definite = joseph_update(self.x, self.P, z, H, R)
        if not definite:
            raise CovarianceError("innovation covariance: expected a positive definite matrix, found another")
        self.x, self.P = x, P
        return float(nis)

    def _moments(self) -> tuple[Floats, Floats]:
        return self.x, self.P
