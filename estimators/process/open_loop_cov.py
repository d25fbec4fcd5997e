"""Covariance of an open-loop estimate of the target: the measured marks drive the model, and no filter corrects it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.linalg import eigh, expm

from dynamics import MassSpringNetwork, rest_shape, state_matrix
from estimators.arrays import Floats
from estimators.process.process_model import accumulated_noise
from estimators.process.target import TargetPoint, target_map

MOTIONS = 90
"""Largest number of vibration modes of the masses without marks [1]; numerical. The slowest modes are used."""

KEPT = 64
"""Largest number of combinations of frame interval and visible marks whose matrices are cached."""


class OpenLoopCovariance:
    """Covariance of the target in an open-loop estimate, linearised about rest.

    Between frames, a marked mass moves straight from one measured position to the next. If a mark is not visible, the
    mass stays at the last measured position. Hidden masses, which have no marks, follow their equations of motion under
    white acceleration noise. For large bodies, only the slowest vibration modes are computed.

    white: density of the acceleration noise [m/s²/sqrt(Hz)]
    State: cov, covariance of the positions and velocities of hidden masses, and of the errors of marked masses.
    """

    def __init__(
        self, network: MassSpringNetwork, target: str | TargetPoint, marked: Sequence[str], white: float
    ) -> None:
        half = network.n_state // 2
        A = state_matrix(network, rest_shape(network))
        driven = [row for node in marked for row in range(network.n_state)[network.coordinates(node)]]
        dim = network.dim
        self._places = {node: slice(k * dim, (k + 1) * dim) for k, node in enumerate(marked)}
        hidden = [row for row in range(half) if row not in set(driven)]
        follow = [*hidden, *(half + row for row in hidden)]
        V, W = (np.kron(np.eye(2), one) for one in _slowest(A[half:, :half][np.ix_(hidden, hidden)], network, hidden))
        self._n, self._m = V.shape[1], len(driven)
        self._own = W @ A[np.ix_(follow, follow)] @ V
        self._by_place = W @ A[np.ix_(follow, driven)]
        self._by_velocity = W @ A[np.ix_(follow, [half + row for row in driven])]
        self._density = (W * ([0.0] * len(hidden) + [white**2] * len(hidden))) @ W.T
        self.cov = np.zeros((self._n + self._m, self._n + self._m))
        matrix = target_map(network, target).matrix
        self._target = np.zeros((network.dim, len(self.cov)))
        self._target[:, : self._n] = matrix[:, hidden] @ V[: len(hidden)]
        self._target[:, self._n :] = matrix[:, driven]
        self._steps: tuple[float, tuple[Floats, Floats, Floats, Floats]] | None = None
        self._frames: dict[tuple[float, frozenset[str]], tuple[Floats, Floats, Floats, Floats]] = {}

    @property
    def target_cov(self) -> Floats:
        """Covariance of the target [m²], (dim, dim)."""
        return np.asarray(self._target @ self.cov @ self._target.T)

    def take(self, dt: float, noise: Mapping[str, Floats]) -> None:
        """Predict over dt [s] to a frame. `noise`: node and covariance [m²], (dim, dim), of each visible mark."""
        dt = round(dt, 10)  # frames at one rate differ by rounding
        key = dt, frozenset(noise)
        if key not in self._frames:
            if len(self._frames) >= KEPT:
                self._frames.clear()
            self._frames[key] = self._matrices(dt, noise)
        F, kept, G, Q = self._frames[key]
        n, R = self._n, np.zeros((self._m, self._m))
        for node, cov in noise.items():
            place = self._places[node]
            R[place, place] = cov
        FP, GR, new = F @ self.cov, G @ R, np.empty_like(self.cov)
        new[:n, :n] = FP @ F.T + GR @ G.T + Q
        new[:n, n:] = FP[:, n:] * kept + GR
        new[n:, :n] = new[:n, n:].T
        new[n:, n:] = self.cov[n:, n:] * np.outer(kept, kept) + R
        self.cov = new

    def _matrices(self, dt: float, seen: Iterable[str]) -> tuple[Floats, Floats, Floats, Floats]:
        """F, kept, G and Q in `take` for a step of dt [s] to a frame that shows the marks of the nodes `seen`."""
        n = self._n
        if dt > 0.0:
            own, start, end, noise_added = self._step(dt)
        else:
            own, start, end = np.eye(n), np.zeros((n, self._m)), np.zeros((n, self._m))
            noise_added = np.zeros((n, n))
        kept = np.ones(self._m)
        for node in seen:
            kept[self._places[node]] = 0.0
        return np.hstack([own, start + end * kept]), kept, end, noise_added

    def _step(self, dt: float) -> tuple[Floats, Floats, Floats, Floats]:
        """Matrices that predict the error of the hidden masses over dt [s].

        Returns the derivatives of the new error with respect to the previous error (n, n), the errors of the previous
        marks (n, m) and those of the new marks (n, m). The last result is the covariance of the noise (n, n).
        """
        if self._steps is None or self._steps[0] != dt:
            n, m = self._n, self._m
            block = np.zeros((n + 2 * m, n + 2 * m))
            block[:n, :n], block[:n, n : n + m], block[:n, n + m :] = self._own, self._by_place, self._by_velocity
            block[n : n + m, n + m :] = np.eye(m)
            moved = expm(block * dt)
            end = moved[:n, n + m :] / dt
            noise = accumulated_noise(self._own, self._density, dt)
            self._steps = dt, (moved[:n, :n], moved[:n, n : n + m] - end, end, noise)
        return self._steps[1]


def _slowest(by_mass: Floats, network: MassSpringNetwork, rows: Sequence[int]) -> tuple[Floats, Floats]:
    """Matrix (n, r) of the slowest vibration modes of n coordinates, and its left inverse. Faster modes are left out.

    by_mass: -K / mass, (n, n); rows: indices of the n coordinates among the free coordinates
    """
    n = len(rows)
    if n <= MOTIONS:
        return np.eye(n), np.eye(n)
    root = np.sqrt(np.repeat(network.masses[network.free], network.dim)[list(rows)])
    scaled = root[:, None] * by_mass / root
    vectors = eigh(0.5 * (scaled + scaled.T), subset_by_index=(n - MOTIONS, n - 1))[1]
    return vectors / root[:, None], vectors.T * root
