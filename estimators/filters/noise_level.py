"""The level of a filter's process noise, learnt from its innovations while it runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats
from estimators.filters.adaptation import VarianceScale
from estimators.filters.kernels import measured

COLOUR_S = 4.0 / 30.0
"""Over so long innovations are summed, so that errors which last count as they add up [s]; choice: one by one those of
a model with wrong constants say less than what is not seen is off by, see docs/decisions.md."""

INFORMATION = 2.0
"""How many independent coordinates the stated level is worth [1]; choice."""


@dataclass(frozen=True, slots=True, eq=False)
class LevelState:
    """The state of a `NoiseLevel`, for going back to it.

    scale, information: of its `VarianceScale`; sensitivity (n, n); passed_s: since the last innovation [s]
    earlier: of innovations, newest first: how long ago [s], the matrix H that they were of, and them whitened, (m,)
    """

    scale: float
    information: float
    sensitivity: Floats
    passed_s: float
    earlier: tuple[tuple[float, Floats, Floats], ...]


class NoiseLevel:
    """The factor on the variances of white process noise, between bounds, by maximum likelihood with forgetting.

    Innovations have the covariance S, and dS / d log(factor) = H D H', where D, the same derivative of the state's
    covariance, moves as that does: D <- F D F' + Q, (1 - K H) D (1 - K H)'. What a factor makes of the gain changes
    nothing to first order, for the gain is the best. In place of single innovations y y' stands their long-run
    covariance, lags weighed by Bartlett's triangle over `COLOUR_S`: of white innovations it is the same.
    Source: [titterington1984]; long-run covariance [newey1987].

    bounds: of the factor; n: of the state; colour_s: in place of `COLOUR_S`
    State: `state`.
    """

    def __init__(self, bounds: tuple[float, float], n: int, colour_s: float = COLOUR_S) -> None:
        self._colour_s = colour_s
        self._factor = VarianceScale(bounds, start_information=INFORMATION)
        self._sensitivity, self._passed_s = np.zeros((n, n)), 0.0
        self._earlier: tuple[tuple[float, Floats, Floats], ...] = ()

    @property
    def scale(self) -> float:
        """The factor on the stated variances [1]."""
        return self._factor.scale

    @property
    def state(self) -> LevelState:
        """All that innovations have changed."""
        own = self._factor
        return LevelState(own.scale, own.information, self._sensitivity, self._passed_s, self._earlier)

    def resume(self, then: LevelState) -> None:
        """Set the state back."""
        self._factor.scale, self._factor.information = then.scale, then.information
        self._sensitivity, self._passed_s, self._earlier = then.sensitivity, then.passed_s, then.earlier

    def forget(self) -> None:
        """The belief is another from now on, one to which the level has added nothing yet."""
        self._sensitivity, self._earlier = np.zeros_like(self._sensitivity), ()

    def predicted(self, F: Floats, added: Floats, dt: float) -> None:
        """The state was moved by F, (n, n), over a step of dt [s], and white noise added to its covariance, (n, n)."""
        D = F @ self._sensitivity @ F.T + added
        self._sensitivity, self._passed_s = 0.5 * (D + D.T), self._passed_s + dt

    def learn(self, innovation: tuple[Floats, Floats, Floats], H: Floats) -> None:
        """Take in an innovation y (m,), its covariance S (m, m) and its gain K (n, m), of a measurement H (m, n)."""
        y, S, K = innovation
        across, part = measured(self._sensitivity, H)
        root = np.linalg.cholesky(S)
        white = np.linalg.solve(root, y)
        ages = [(age + self._passed_s, one, earlier) for age, one, earlier in self._earlier]
        ages = [each for each in ages if each[0] < self._colour_s]
        lags = [(1.0 - age / self._colour_s, earlier) for age, one, earlier in ages if np.array_equal(one, H)]
        share = np.linalg.solve(root, np.linalg.solve(root, part).T)
        # no more than all can come of the noise: then the belief was changed by something else meanwhile
        whole = max(1.0, float(np.diag(share).max()))
        share = share / whole
        self._factor.learn_whitened(white, share, self._passed_s, lags)
        taken = K @ (across - 0.5 * part @ K.T)
        self._sensitivity, self._passed_s = (self._sensitivity - taken - taken.T) / whole, 0.0
        self._earlier = ((0.0, H, white), *ages)
