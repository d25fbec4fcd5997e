"""The filter of the tissue: its equations of motion as the process model, an unknown poke on each marked node.

The state of the filter is the network's (positions, then velocities of the free nodes) followed by the poke on each
marked node [N], node-major.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from dynamics import MassSpringNetwork, Stepper, pack, rest_shape, state_matrix
from estimators.estimate import MarkMeasurement, Status, TargetEstimate
from estimators.mixture import InteractingMixture
from estimators.unscented import UnscentedKalmanFilter

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ForceMode:
    """One belief about the unknown force.

    white: acceleration noise on every free node [m/s²/sqrt(Hz)]: what the model leaves out
    poke: standard deviation of the poke on each marked node, by its mass [m/s²]
    lasting_s: correlation time of the poke, a first-order Gauss-Markov process [s]
    """

    white: float
    poke: float
    lasting_s: float


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """What the filter assumes about forces it cannot see; every figure chosen, see `docs/decisions.md`.

    quiet_s, poked_s: how long a quiet and a poked spell last on average [s]
    settle_s: the filter starts as unsure as the tissue would be after unseen pokes of this duration [s]
    lost_s: without any mark for longer than this the target counts as lost [s]
    """

    quiet: ForceMode = ForceMode(white=0.05, poke=0.05, lasting_s=0.05)
    poked: ForceMode = ForceMode(white=0.05, poke=10.0, lasting_s=0.2)
    quiet_s: float = 1.0
    poked_s: float = 0.5
    settle_s: float = 5.0
    lost_s: float = 1.0


class TissueModel:
    """Process model of a network whose marked nodes are poked by unknown forces.

    dim_x: the network's state and one poke for each coordinate of a marked node
    """

    def __init__(self, network: MassSpringNetwork, marked: Sequence[str]) -> None:
        self.network = network
        self.stepper = Stepper(network)
        places = [network.coordinates(node) for node in marked]
        self.poked_rows = np.array([i for place in places for i in range(place.start, place.stop)], dtype=np.int64)
        self.dim_x = network.n_state + len(self.poked_rows)
        self.mass = np.repeat(network.masses[network.free], network.dim)

    def propagate(self, points: Floats, dt: float, mode: ForceMode) -> Floats:
        """Sigma points (n_points, dim_x) dt seconds later, each under its own poke, which fades meanwhile."""
        n = self.network.n_state
        fade = np.exp(-dt / mode.lasting_s)
        mean_share = (1.0 - fade) * mode.lasting_s / dt  # of the poke at the start, over the step
        forces = np.zeros((len(points), n // 2))
        forces[:, self.poked_rows] = mean_share * points[:, n:]
        moved = self.stepper.advance(points[:, :n], dt, forces)
        return np.concatenate([moved, fade * points[:, n:]], axis=1)

    def noise(self, dt: float, mode: ForceMode) -> Floats:
        """Covariance that a step of dt [s] adds, (dim_x, dim_x), by the exact discretisation of each free coordinate.

        Springs are left out of it: over one step they move noise by (w dt)², with steps of 1/240 s under 1 %.
        """
        n, half = self.network.n_state, self.network.n_state // 2
        Q = np.zeros((self.dim_x, self.dim_x))
        q, v = np.arange(half), np.arange(half, n)
        white = mode.white**2
        Q[q, q], Q[v, v] = white * dt**3 / 3.0, white * dt
        Q[q, v] = Q[v, q] = white * dt**2 / 2.0
        poke = _poke_noise(dt, mode)
        for k, row in enumerate(self.poked_rows):
            three = np.array([row, half + row, n + k])
            scale = np.array([1.0, 1.0, self.mass[row]])
            Q[np.ix_(three, three)] += scale[:, None] * poke * scale
        return Q

    def linearised(self, rest: Floats, mode: ForceMode) -> tuple[Floats, Floats]:
        """Matrix A and noise density of the augmented motion about a rest shape, each (dim_x, dim_x)."""
        n, half = self.network.n_state, self.network.n_state // 2
        A = np.zeros((self.dim_x, self.dim_x))
        A[:n, :n] = state_matrix(self.network, rest)
        density = np.zeros_like(A)
        density[range(half, n), range(half, n)] = mode.white**2
        for k, row in enumerate(self.poked_rows):
            A[half + row, n + k] = 1.0 / self.mass[row]
            A[n + k, n + k] = -1.0 / mode.lasting_s
            density[n + k, n + k] = 2.0 * (mode.poke * self.mass[row]) ** 2 / mode.lasting_s
        return A, density


def grown_covariance(A: Floats, density: Floats, seconds: float) -> Floats:
    """Covariance after so many seconds of dx/dt = A x + white noise of that density, from none; (n, n).

    Source: [vanloan1978]. Unlike Lyapunov's equation it needs no damping.
    """
    n = len(A)
    step, doublings = seconds, 0
    while np.abs(A).sum(axis=1).max() * step > 1.0:
        step, doublings = step / 2.0, doublings + 1
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:], block[n:, n:] = -A, density, A.T
    grown = expm(block * step)
    F = grown[n:, n:].T
    Q = F @ grown[:n, n:]
    for _ in range(doublings):
        Q, F = F @ Q @ F.T + Q, F @ F
    return 0.5 * (Q + Q.T)


def _poke_noise(dt: float, mode: ForceMode) -> Floats:
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0 / mode.lasting_s]])
    density = np.diag([0.0, 0.0, 2.0 * mode.poke**2 / mode.lasting_s])
    return grown_covariance(A, density, dt)


class TissueFilter:
    """Where the target is: a quiet and a poked unscented filter of the tissue, mixed by what the marks say.

    State: mixture (the bank of filters), time_s (of the state, None before the first frame), seen_s (last time a
    mark was taken in).
    """

    def __init__(
        self,
        network: MassSpringNetwork,
        target: str,
        marked: Sequence[str],
        settings: FilterSettings | None = None,
    ) -> None:
        self.settings = FilterSettings() if settings is None else settings
        self.model = TissueModel(network, marked)
        self.time_s: float | None = None
        self.seen_s: float | None = None
        self._target = network.coordinates(target)
        self._places = {name: network.coordinates(name) for name in (network.names[i] for i in network.free)}
        rest = rest_shape(network)
        mean = np.zeros(self.model.dim_x)
        mean[: network.n_state] = pack(rest[network.free], np.zeros_like(rest[network.free]))
        A, density = self.model.linearised(rest, self.settings.poked)
        cov = grown_covariance(A, density, self.settings.settle_s)
        self._noises: dict[tuple[int, float], Floats] = {}
        modes = [self.settings.quiet, self.settings.poked]
        filters = [self._started(mode, mean, cov) for mode in modes]
        leave = np.array([1.0 / self.settings.quiet_s, 1.0 / self.settings.poked_s])
        rates = np.array([[-leave[0], leave[0]], [leave[1], -leave[1]]])
        share = leave[::-1] / leave.sum()
        self.mixture = InteractingMixture(filters, share, rates)

    def _started(self, mode: ForceMode, mean: Floats, cov: Floats) -> UnscentedKalmanFilter:
        f = UnscentedKalmanFilter(self.model.dim_x, lambda points, dt: self.model.propagate(points, dt, mode))
        f.x, f.P = mean.copy(), cov.copy()
        return f

    def predict(self, time_s: float) -> None:
        """Move the state to this exposure time [s]; raises ValueError where time goes back."""
        if self.time_s is not None:
            dt = time_s - self.time_s
            if dt < 0:
                raise ValueError(f"time_s: expected {self.time_s} or later, found {time_s}")
            if dt > 0:
                self._advance(dt)
        self.time_s = time_s

    def _advance(self, dt: float) -> None:
        step = dt / self.model.stepper.n_steps(dt)
        for f, mode in zip(self.mixture.filters, (self.settings.quiet, self.settings.poked), strict=True):
            f.Q = self.model.noise(step, mode)
        self.mixture.predict(dt, step)

    def expected(self, node: str) -> tuple[Floats, Floats]:
        """Where a free node is believed to be [m], (dim,), and the covariance of that [m²], (dim, dim)."""
        place = self._places[node]
        return self.mixture.x[place].copy(), self.mixture.P[place, place].copy()

    def update(self, marks: Sequence[MarkMeasurement]) -> TargetEstimate:
        """Take in the marks that were seen at the state's time, any number of them, and say where the target is."""
        if self.time_s is None:
            raise ValueError("update: expected predict(time_s) before, found no time")
        nis = None
        if marks:
            rows = [i for mark in marks for i in range(self._places[mark.node].start, self._places[mark.node].stop)]
            dim = self.model.network.dim
            H = np.zeros((len(rows), self.model.dim_x))
            H[range(len(rows)), rows] = 1.0
            R = np.zeros((len(rows), len(rows)))
            for k, mark in enumerate(marks):
                R[k * dim : (k + 1) * dim, k * dim : (k + 1) * dim] = mark.cov
            z = np.concatenate([mark.position for mark in marks])
            y, S = z - H @ self.mixture.x, H @ self.mixture.P @ H.T + R
            nis = float(y @ np.linalg.solve(S, y))
            self.mixture.update_linear(z, H, R)
            self.seen_s = self.time_s
        return TargetEstimate(
            time_s=self.time_s,
            mean=self.mixture.x[self._target].copy(),
            cov=self.mixture.P[self._target, self._target].copy(),
            status=self._status(),
            marks_used=len(marks),
            nis=nis,
            poked=float(self.mixture.mu[1]),
        )

    def _status(self) -> Status:
        if self.seen_s is None:
            return Status.LOST
        unseen = (self.time_s or 0.0) - self.seen_s
        if unseen == 0.0:
            return Status.TRACKING
        return Status.COASTING if unseen <= self.settings.lost_s else Status.LOST
