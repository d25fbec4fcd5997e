"""Maximum-likelihood estimate of a factor on a part of the innovation covariance."""

from __future__ import annotations

import numpy as np

from estimators.arrays import Floats


class VarianceScale:
    """Recursive maximum-likelihood estimate of the factor `scale` in the innovation covariance `rest + scale * part`.

    Each innovation changes log(scale) by the score divided by the Fisher information. The information from earlier
    innovations decays with the time constant forget_s. Source: [titterington1984].

    bounds: smallest and largest scale
    start_information: weight of the initial scale 1, as the number of measured coordinates with the same information
    State: scale; information, the Fisher information of log(scale).
    """

    def __init__(self, bounds: tuple[float, float], forget_s: float = 10.0, start_information: float = 10.0) -> None:
        low, high = bounds
        if not 0.0 < low <= high:
            raise ValueError(f"bounds: expected 0 < low <= high, found {bounds}")
        self.bounds = bounds
        self.forget_s = forget_s
        self.scale = float(np.clip(1.0, low, high))
        self.information = self._start = 0.5 * start_information

    def learn(self, innovation: Floats, part: Floats, rest: Floats, dt: float) -> float:
        """Update with an innovation (m,), a time dt [s] after the previous innovation. Returns the new `scale`.

        part, rest: the two terms of the innovation covariance `rest + scale * part`, (m, m)
        """
        scaled = self.scale * part
        root = np.linalg.cholesky(rest + scaled)
        share = np.linalg.solve(root, np.linalg.solve(root, scaled).T)
        white = np.linalg.solve(root, innovation)
        score = 0.5 * float(white @ share @ white - np.trace(share))
        kept = float(np.exp(-dt / self.forget_s))
        gained = 0.5 * float(np.sum(share * share.T))
        self.information = kept * self.information + (1.0 - kept) * self._start + gained
        # a step of at most one in the logarithm: far from the maximum the score gives only the direction
        step = float(np.clip(score / self.information, -1.0, 1.0))
        self.scale = float(np.clip(self.scale * np.exp(step), *self.bounds))
        return self.scale
