"""The level of a filter's process noise, learnt from its innovations while it runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats
from estimators.filters.adaptation import VarianceScale
from estimators.filters.kernels import measured

INFORMATION = 2.0
"""How many independent coordinates the stated level is worth [1]; choice."""


@dataclass(frozen=True, slots=True, eq=False)
class LevelState:
    """The state of a `NoiseLevel`, for going back to it.

    scale, information: of its `VarianceScale`; passed_s: since the last innovation [s]
    mean_slope, cov_slope: derivatives of the belief by the logarithm of the factor, mean (n,) and covariance (n, n)
    """

    scale: float
    information: float
    mean_slope: Floats
    cov_slope: Floats
    passed_s: float


class NoiseLevel:
    """The factor on the variances of white process noise, between bounds, by maximum likelihood with forgetting.

    Its score is that of the innovations of a whole recording: a factor changes their covariance S, and their means, by
    what the gains that it brought about have made of earlier ones. Derivatives by its logarithm, from step to step:
    D of the belief's covariance and d of its mean move as those do,

        D <- F D F' + Q,  d <- F d;    D <- (1 - K H) D (1 - K H)',  d <- (1 - K H) (d + D H' S^-1 y)

    A factor that is too small leaves innovations which last, and each of them says so by d of those before it: one by
    one they show little of what they add up to.
    Source: sensitivities of the innovations [gupta1974]; with forgetting [titterington1984].

    bounds: of the factor; n: of the state
    State: `state`.
    """

    def __init__(self, bounds: tuple[float, float], n: int) -> None:
        self._factor = VarianceScale(bounds, start_information=INFORMATION)
        self._mean_slope, self._cov_slope, self._passed_s = np.zeros(n), np.zeros((n, n)), 0.0

    @property
    def scale(self) -> float:
        """The factor on the stated variances [1]."""
        return self._factor.scale

    @property
    def state(self) -> LevelState:
        """All that innovations have changed."""
        return LevelState(
            self._factor.scale, self._factor.information, self._mean_slope, self._cov_slope, self._passed_s
        )

    def resume(self, then: LevelState) -> None:
        """Set the state back."""
        self._factor.scale, self._factor.information = then.scale, then.information
        self._mean_slope, self._cov_slope, self._passed_s = then.mean_slope, then.cov_slope, then.passed_s

    def forget(self) -> None:
        """The belief is another from now on, one to which the level has added nothing yet."""
        self._mean_slope, self._cov_slope = np.zeros_like(self._mean_slope), np.zeros_like(self._cov_slope)

    def predicted(self, F: Floats, added: Floats, dt: float) -> None:
        """The state was moved by F, (n, n), over a step of dt [s], and white noise added to its covariance, (n, n)."""
        D = F @ self._cov_slope @ F.T + added
        self._mean_slope, self._cov_slope, self._passed_s = F @ self._mean_slope, 0.5 * (D + D.T), self._passed_s + dt

    def learn(self, innovation: tuple[Floats, Floats, Floats], H: Floats) -> None:
        """Take in an innovation y (m,), its covariance S (m, m) and its gain K (n, m), of a measurement H (m, n)."""
        y, S, K = innovation
        across, part = measured(self._cov_slope, H)
        root = np.linalg.cholesky(S)
        share = np.linalg.solve(root, np.linalg.solve(root, part).T)
        # no more than all can come of the noise: then the belief was changed by something else meanwhile
        whole = max(1.0, float(np.diag(share).max()))
        D, d, across, part, share = (each / whole for each in (self._cov_slope, self._mean_slope, across, part, share))
        white, moved = np.linalg.solve(root, np.c_[y, H @ d]).T
        self._factor.learn_whitened(white, share, self._passed_s, -moved)
        taken = K @ (across - 0.5 * part @ K.T)
        self._cov_slope, self._passed_s = D - taken - taken.T, 0.0
        self._mean_slope = d - K @ (H @ d) + (across.T - K @ part) @ np.linalg.solve(root.T, white)
