"""Process model of a tissue: equations of motion of a network, with an unknown poke on each marked node.

The state has the network's state (positions, then velocities of the free nodes), then the poke on each
marked coordinate [N], node by node.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from dynamics import (
    MassSpringNetwork,
    ParameterUncertainty,
    Stepper,
    parameter_forces,
    state_matrix,
    stiffness_matrix,
)
from estimators.arrays import Floats

LONGEST_STEP = 1.0 / 120.0
"""Longest time between two additions of noise [s]; choice: the error is 23 µm and 0.5 % of the covariance after 0.2 s;
with 1/240 s the computation takes twice as long."""

LOOSE = 1e-11
"""Relative stiffness below which a motion counts as free, because rounding errors are as large."""

LEGENDRE = np.polynomial.legendre.leggauss(12)
"""Quadrature nodes and weights on (-1, 1); for steps up to twice the correlation time only rounding errors remain."""


@dataclass(frozen=True, slots=True)
class ForceMode:
    """Unknown forces in one mode.

    white: acceleration noise on every free node, for errors of the model [m/s²/sqrt(Hz)]; choice
    poke: standard deviation of the poke on each marked node, divided by its mass [m/s²]; choice
    lasting_s: correlation time of the poke, a first-order Gauss-Markov process [s]; choice
    """

    white: float
    poke: float
    lasting_s: float


QUIET = ForceMode(white=0.043, poke=0.043, lasting_s=0.05)
"""Forces without pokes; choice."""


@dataclass(frozen=True, slots=True)
class FixBias:
    """Common error of all fixes of the target: sd [m] for each axis, with correlation time lasting_s [s]."""

    sd_m: float
    lasting_s: float = 60.0


class TissueModel:
    """Process model of a network with unknown forces on its marked nodes.

    uncertainty: directions in which the network's constants are uncertain
    dim_x: number of states: the network's, and one poke for each coordinate of a poked node
    """

    def __init__(
        self, network: MassSpringNetwork, marked: Sequence[str], *, uncertainty: ParameterUncertainty | None = None
    ) -> None:
        self.network, self.uncertainty = network, uncertainty
        self.stepper = Stepper(network, LONGEST_STEP)
        places = [network.coordinates(node) for node in marked]
        self.poked_rows = np.array([i for place in places for i in range(place.start, place.stop)], dtype=np.int64)
        self.dim_x = network.n_state + len(self.poked_rows)
        self.mass = np.repeat(network.masses[network.free], network.dim)

    def propagate(self, points: Floats, dt: float, mode: ForceMode) -> Floats:
        """Sigma points (n_points, dim_x) after dt [s], each with its own poke, which decays.

        The states are in [m], [m/s] and [N].
        """
        return self.propagate_each(points[None], dt, (mode,))[0]

    def propagate_each(self, points: Floats, dt: float, modes: Sequence[ForceMode]) -> Floats:
        """Sigma points of each mode, (n_modes, n_points, dim_x), after dt [s], in [m], [m/s], [N]."""
        n = self.network.n_state
        lasting = np.array([mode.lasting_s for mode in modes])[:, None, None]
        fade = np.exp(-dt / lasting)
        forces = np.zeros((*points.shape[:2], n // 2))
        # mean share, over the step, of the poke at the start
        forces[:, :, self.poked_rows] = (1.0 - fade) * lasting / dt * points[:, :, n:]
        ahead = self.stepper.advance(points[:, :, :n].reshape(-1, n), dt, forces.reshape(-1, n // 2))
        return np.concatenate([ahead.reshape(*points.shape[:2], n), fade * points[:, :, n:]], axis=2)

    def resting_columns(self, shape: Floats) -> Floats:
        """Change of a rest shape by an error of the constants along each direction, (dim_x, n_directions).

        shape: positions of all nodes [m], (n_nodes, dim)
        """
        if self.uncertainty is None:
            return np.zeros((self.dim_x, 0))
        half = self.network.n_state // 2
        forces = parameter_forces(self.network, self.uncertainty.parameters, shape, np.zeros_like(shape))
        forces = self.uncertainty.directions @ forces
        columns = np.zeros((self.dim_x, len(forces)))
        # rigid motions without a fixed node have no resistance: errors of the constants cause none
        columns[:half] = np.linalg.lstsq(stiffness_matrix(self.network, shape), forces.T, rcond=LOOSE)[0]
        return columns

    def noise(self, dt: float, mode: ForceMode) -> Floats:
        """Covariance of the noise of a step of dt [s], (dim_x, dim_x), by exact discretisation of each free coordinate.

        Springs and dashpots are ignored: over the longest step, 1/120 s, they change the variances of the phantom's
        noise by up to 31 %. `LONGEST_STEP` states the resulting error of a prediction, at any frame rate.
        """
        n, half = self.network.n_state, self.network.n_state // 2
        Q = np.zeros((self.dim_x, self.dim_x))
        _add_flight(Q, np.full(half, mode.white**2), dt)
        poke = np.array([_poke_noise(dt, mode.poke, mode.lasting_s)] * len(self.poked_rows))
        rows, mass = self.poked_rows, self.mass[self.poked_rows]
        places = (rows, half + rows, n + np.arange(len(rows)))
        scales = (np.ones(len(rows)), np.ones(len(rows)), mass)  # acceleration to force in the third only
        for a in range(3):
            for b in range(3):
                Q[places[a], places[b]] += scales[a] * poke[:, a, b] * scales[b]
        return Q

    def linearised(self, shape: Floats, mode: ForceMode) -> tuple[Floats, Floats]:
        """Matrix A and noise density of the augmented motion about a shape [m], (dim_x, dim_x); in [m], [m/s], [N].

        Unstable motions, such as of a compressed link, keep their speed instead of growing: the real body moves
        to another rest shape, while a linear motion would diverge.
        """
        n, half = self.network.n_state, self.network.n_state // 2
        A = np.zeros((self.dim_x, self.dim_x))
        A[:n, :n] = state_matrix(self.network, shape)
        A[half:n, :half] = _without_growth(A[half:n, :half], self.mass)
        density = np.zeros_like(A)
        density[range(half, n), range(half, n)] = mode.white**2
        for k, row in enumerate(self.poked_rows):
            A[half + row, n + k] = 1.0 / self.mass[row]
            A[n + k, n + k] = -1.0 / mode.lasting_s
            density[n + k, n + k] = 2.0 * (mode.poke * self.mass[row]) ** 2 / mode.lasting_s
        return A, density


def _add_flight(Q: Floats, white: Floats, dt: float) -> None:
    """Add the covariance of positions and velocities from accelerations of these densities, (half,), over dt [s]."""
    q = np.arange(len(white))
    v = len(white) + q
    Q[q, q] += white * dt**3 / 3.0
    Q[v, v] += white * dt
    Q[q, v] += white * dt**2 / 2.0
    Q[v, q] += white * dt**2 / 2.0


def _without_growth(by_mass: Floats, mass: Floats) -> Floats:
    """Matrix -K / mass, (n, n), without the motions of negative stiffness; unchanged if there are none."""
    root = np.sqrt(mass)
    scaled = root[:, None] * by_mass / root
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    if values[-1] <= 0.0:
        return by_mass
    return np.asarray((vectors * np.minimum(values, 0.0)) @ vectors.T * root / root[:, None])


def accumulated_noise(A: Floats, density: Floats, seconds: float) -> Floats:
    """Covariance (n, n) of x after this time [s] if x starts at zero and dx/dt = A x + white noise of this density.

    Source: [vanloan1978]. Unlike Lyapunov's equation, this needs no damping.
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


def _poke_noise(dt: float, sd: float, tau: float) -> Floats:
    """Covariance of position, velocity and poke per mass after dt [s] of a first-order Gauss-Markov force, (3, 3).

    sd: standard deviation of the force per mass [m/s²]; tau: its correlation time [s]

    It is the Gauss-Legendre integral of g g' over the age of the noise, with g the response to noise of that age.
    """
    s = 0.5 * dt * (LEGENDRE[0] + 1.0)
    gone = -np.expm1(-s / tau)
    g = np.array([tau * (s - tau * gone), tau * gone, 1.0 - gone])
    Q = (0.5 * dt * LEGENDRE[1] * (2.0 * sd**2 / tau) * g) @ g.T
    return 0.5 * (Q + Q.T)
