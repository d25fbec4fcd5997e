"""Constant-speed Kalman filter for a tracked needle: position of the tip, and time of the tip's arrival.

The state is the position `p` of the tip and its speed `s` along a line of direction `d`. The model is `dp/dt = s d`
plus bending across the line, and `ds/dt` is white noise. Along the line, this is the discretised continuous white noise
acceleration model of [barshalom2001], section 6.3.2. Across the line, the tip follows a random walk: the needle bends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from estimators.arrays import Floats
from estimators.consistency.joseph import joseph_update
from estimators.filters.unscented import CovarianceError


@dataclass(frozen=True, slots=True)
class NeedleNoise:
    """Process noise of a needle.

    acceleration: density of the acceleration noise along the needle [m/s²/sqrt(Hz)]; choice: in one second, this noise
        changes the speed by a random value with a standard deviation of 10 mm/s
    bending: density of the velocity noise across the needle [m/sqrt(s)]; choice
    speed_sd: standard deviation of the speed before any measurement [m/s]; choice
    """

    acceleration: float = 0.01
    bending: float = 2e-4
    speed_sd: float = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Arrival:
    """Time at which the tip arrives at a depth [s], and standard deviation of this time to first order [s]."""

    time_s: float
    sd_s: float


class NeedleTracker:
    """Kalman filter for the tip of a needle that moves along a line.

    entry: point where the line meets the skin [m], (dim,); direction: direction of insertion, normalised, (dim,)
    State: time_s, the time of the estimate [s]; mean x and covariance P of the tip's position [m] and its speed along
    the line [m/s], (dim + 1,) and (dim + 1, dim + 1); nis, the normalised innovation squared of the last measurement.
    Raises ValueError for a direction without length.
    """

    def __init__(self, entry: ArrayLike, direction: ArrayLike, noise: NeedleNoise | None = None) -> None:
        self.entry = np.array(entry, dtype=float)
        along = np.array(direction, dtype=float)
        length = float(np.linalg.norm(along))
        if along.shape != self.entry.shape or not 0.0 < length < np.inf:
            raise ValueError(f"direction: expected shape {self.entry.shape} and not all 0, found {along}")
        self.direction = along / length
        self.noise = NeedleNoise() if noise is None else noise
        self.time_s: float | None = None
        self.nis: float | None = None
        self.x = np.r_[self.entry, 0.0]
        self.P = np.zeros((len(self.x), len(self.x)))

    @property
    def depth(self) -> tuple[float, float]:
        """Depth of the tip beyond the entry, measured along the line [m], and standard deviation of the depth [m]."""
        d = self.direction
        return float((self.x[:-1] - self.entry) @ d), float(np.sqrt(d @ self.P[:-1, :-1] @ d))

    @property
    def speed(self) -> tuple[float, float]:
        """Speed of the tip along the line [m/s], and standard deviation of the speed [m/s]."""
        return float(self.x[-1]), float(np.sqrt(self.P[-1, -1]))

    def predict(self, time_s: float) -> None:
        """Predict the tip at a time [s]; raises ValueError if this time is before the last time, or not finite."""
        self.x, self.P = self._ahead(time_s)
        self.time_s = time_s

    def tip_at(self, time_s: float) -> tuple[Floats, Floats]:
        """Predicted position of the tip at a later time [m], (dim,), and its covariance [m²], (dim, dim).

        Raises ValueError before the first measurement, and if the time is before the present time or not finite.
        """
        if self.time_s is None:
            raise ValueError("tip_at: expected a measurement first, found none")
        x, P = self._ahead(time_s)
        return x[:-1], P[:-1, :-1]

    def update(self, position: ArrayLike, cov: ArrayLike) -> None:
        """Update with a measured position of the tip at the present time [m], (dim,).

        cov: covariance of the measured position [m²], (dim, dim)
        The first position initialises the filter. Raises ValueError for other shapes and before `predict`. Raises
        CovarianceError if the innovation covariance is not positive definite.
        """
        z, R = np.asarray(position, dtype=float), np.asarray(cov, dtype=float)
        dim = len(self.entry)
        if z.shape != (dim,) or R.shape != (dim, dim) or not (np.isfinite(z).all() and np.isfinite(R).all()):
            raise ValueError(
                f"tip: expected finite numbers of shapes {(dim,)}, {(dim, dim)}, found {z.shape}, {R.shape}"
            )
        if self.time_s is None:
            raise ValueError("update: expected predict(time_s) first, found no time")
        if not self.P.any():
            self.x = np.r_[z, 0.0]
            self.P[:-1, :-1], self.P[-1, -1] = R, self.noise.speed_sd**2
            return
        x, P, _y, _S, _K, nis, _log_det, definite = joseph_update(self.x, self.P, z, np.eye(dim, dim + 1), R)
        if not definite:
            raise CovarianceError("innovation covariance: expected a positive definite matrix, found another")
        self.x, self.P, self.nis = x, P, float(nis)

    def arrival(self, depth_m: float) -> Arrival | None:
        """Time at which the tip reaches a depth [m]; None if the tip does not move forward or is already deeper."""
        depth, _ = self.depth
        speed, _ = self.speed
        if self.time_s is None or not speed > 0.0 or depth_m < depth:
            return None
        t = (depth_m - depth) / speed
        _, P = self._ahead(self.time_s + t)
        d = self.direction
        return Arrival(self.time_s + t, float(np.sqrt(d @ P[:-1, :-1] @ d)) / speed)

    def _ahead(self, time_s: float) -> tuple[Floats, Floats]:
        if not np.isfinite(time_s) or (self.time_s is not None and time_s < self.time_s):
            raise ValueError(f"time_s: expected {self.time_s} or later, found {time_s}")
        if self.time_s is None or not self.P.any():
            return self.x, self.P
        dt, d = time_s - self.time_s, self.direction
        F = np.eye(len(self.x))
        F[:-1, -1] = dt * d
        q, across = self.noise.acceleration**2, self.noise.bending**2
        along = np.outer(d, d)
        Q = np.zeros_like(F)
        Q[:-1, :-1] = q * dt**3 / 3.0 * along + across * dt * (np.eye(len(d)) - along)
        Q[:-1, -1] = Q[-1, :-1] = q * dt**2 / 2.0 * d
        Q[-1, -1] = q * dt
        P = F @ self.P @ F.T + Q
        return F @ self.x, 0.5 * (P + P.T)
