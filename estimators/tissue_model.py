"""The tissue as a process model: its equations of motion, with an unknown poke on each marked node.

The state of the filter is the network's (positions, then velocities of the free nodes) followed by the poke on each
marked coordinate [N], node-major.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynamics import MassSpringNetwork, Stepper, state_matrix
from estimators.exponential import small_expm

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

        Springs and dashpots are left out of it: over a step of 1/240 s they change the phantom's by some 10 %, and the
        predicted covariance by 2 %, the same at every frame rate since steps are.
        """
        n, half = self.network.n_state, self.network.n_state // 2
        Q = np.zeros((self.dim_x, self.dim_x))
        q, v = np.arange(half), np.arange(half, n)
        white = mode.white**2
        Q[q, q], Q[v, v] = white * dt**3 / 3.0, white * dt
        Q[q, v] = Q[v, q] = white * dt**2 / 2.0
        poke = _poke_noise(dt, mode)
        rows, mass = self.poked_rows, self.mass[self.poked_rows]
        places = (rows, half + rows, n + np.arange(len(rows)))
        scales = (np.ones(len(rows)), np.ones(len(rows)), mass)  # acceleration to force in the third only
        for a in range(3):
            for b in range(3):
                Q[places[a], places[b]] += scales[a] * poke[a, b] * scales[b]
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
    grown = small_expm(block * step)
    F = grown[n:, n:].T
    Q = F @ grown[:n, n:]
    for _ in range(doublings):
        Q, F = F @ Q @ F.T + Q, F @ F
    return 0.5 * (Q + Q.T)


def _poke_noise(dt: float, mode: ForceMode) -> Floats:
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0 / mode.lasting_s]])
    density = np.diag([0.0, 0.0, 2.0 * mode.poke**2 / mode.lasting_s])
    return grown_covariance(A, density, dt)
