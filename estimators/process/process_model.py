"""Process model of a tissue: motion of a network under an unknown brief force (poke) on each marked node.

The state contains the positions of the free nodes, their velocities, and the poke on each coordinate of a marked
node [N], node by node.
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
"""Longest integration step [s]; choice. A prediction over 0.2 s has an error of 23 µm in the mean and 0.5 % in the
covariance. With steps of 1/240 s, the computation takes twice as long."""

LOOSE = 1e-11
"""A stiffness below this share of the largest stiffness is a rounding error and counts as zero [1]; numerical."""

LEGENDRE = np.polynomial.legendre.leggauss(12)
"""Quadrature nodes and weights on (-1, 1). In steps up to twice the correlation time, only rounding errors remain."""


@dataclass(frozen=True, slots=True)
class ForceMode:
    """Unknown forces in one mode: white noise on all free nodes, and pokes (brief forces) on marked nodes.

    white: density of acceleration noise, which represents errors of the model [m/s²/sqrt(Hz)]; choice
    poke: standard deviation of the acceleration that a poke gives to its node [m/s²]; choice
    lasting_s: correlation time of a poke, a Gauss-Markov process of first order [s]; choice
    """

    white: float
    poke: float
    lasting_s: float

    def __post_init__(self) -> None:
        for name in ("white", "poke"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise ValueError(f"forces {name}: expected 0 or more, found {getattr(self, name)}")
        if not self.lasting_s > 0.0:
            raise ValueError(f"forces lasting_s: expected more than 0, found {self.lasting_s}")


QUIET = ForceMode(white=0.043, poke=0.043, lasting_s=0.05)
"""Unknown forces while no poke acts; choice."""


@dataclass(frozen=True, slots=True)
class FixBias:
    """Common error of all fixes of the target: standard deviation on each axis [m], and correlation time [s]."""

    sd_m: float
    lasting_s: float = 60.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.sd_m < np.inf:
            raise ValueError(f"fix_bias sd_m: expected 0 or more, found {self.sd_m}")
        if not self.lasting_s > 0.0:
            raise ValueError(f"fix_bias lasting_s: expected more than 0, found {self.lasting_s}")


class TissueModel:
    """Process model of a network under unknown forces.

    uncertainty: uncertainty of the network's constants
    dim_x: number of states, which are positions, velocities, and a poke for each coordinate of a marked node
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
        """Sigma points (n_points, dim_x) after dt [s], with states in [m], [m/s], [N]."""
        return self.propagate_each(points[None], dt, (mode,))[0]

    def propagate_each(self, points: Floats, dt: float, modes: Sequence[ForceMode]) -> Floats:
        """Sigma points of each mode, (n_modes, n_points, dim_x), after dt [s], with states in [m], [m/s], [N]."""
        n = self.network.n_state
        lasting = np.array([mode.lasting_s for mode in modes])[:, None, None]
        fade = np.exp(-dt / lasting)
        forces = np.zeros((*points.shape[:2], n // 2))
        # mean of the decaying poke over the step
        forces[:, :, self.poked_rows] = (1.0 - fade) * lasting / dt * points[:, :, n:]
        ahead = self.stepper.advance(points[:, :, :n].reshape(-1, n), dt, forces.reshape(-1, n // 2))
        return np.concatenate([ahead.reshape(*points.shape[:2], n), fade * points[:, :, n:]], axis=2)

    def resting_columns(self, shape: Floats) -> Floats:
        """Change of the rest shape per standard deviation of each error of the constants, (dim_x, n_directions).

        shape: positions of all nodes [m], (n_nodes, dim)
        """
        if self.uncertainty is None:
            return np.zeros((self.dim_x, 0))
        half = self.network.n_state // 2
        forces = parameter_forces(self.network, self.uncertainty.parameters, shape, np.zeros_like(shape))
        forces = self.uncertainty.directions @ forces
        columns = np.zeros((self.dim_x, len(forces)))
        # rigid motions of a body without a fixed node meet no stiffness and are left out
        columns[:half] = np.linalg.lstsq(stiffness_matrix(self.network, shape), forces.T, rcond=LOOSE)[0]
        return columns

    def noise(self, dt: float, mode: ForceMode) -> Floats:
        """Noise covariance of a step of dt [s], (dim_x, dim_x). Springs and dashpots are ignored during the step."""
        n, half = self.network.n_state, self.network.n_state // 2
        Q = np.zeros((self.dim_x, self.dim_x))
        _add_flight(Q, np.full(half, mode.white**2), dt)
        poke = np.array([_poke_noise(dt, mode.poke, mode.lasting_s)] * len(self.poked_rows))
        rows, mass = self.poked_rows, self.mass[self.poked_rows]
        places = (rows, half + rows, n + np.arange(len(rows)))
        scales = (np.ones(len(rows)), np.ones(len(rows)), mass)  # only the third is a force, not an acceleration
        for a in range(3):
            for b in range(3):
                Q[places[a], places[b]] += scales[a] * poke[:, a, b] * scales[b]
        return Q

    def linearised(self, shape: Floats, mode: ForceMode) -> tuple[Floats, Floats]:
        """Matrix A (dim_x, dim_x) and noise density (dim_x, dim_x) of motion near a shape [m]. States: [m], [m/s], [N].

        Negative stiffnesses, such as that of a buckling link, are replaced by zero, so that no motion grows.
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
    """Add to Q the covariance due to white acceleration noise over dt [s]. white: density on each coordinate, (n,)."""
    q = np.arange(len(white))
    v = len(white) + q
    Q[q, q] += white * dt**3 / 3.0
    Q[v, v] += white * dt
    Q[q, v] += white * dt**2 / 2.0
    Q[v, q] += white * dt**2 / 2.0


def _without_growth(by_mass: Floats, mass: Floats) -> Floats:
    """Matrix -K / mass, (n, n), in which negative stiffnesses are replaced by zero."""
    root = np.sqrt(mass)
    scaled = root[:, None] * by_mass / root
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    if values[-1] <= 0.0:
        return by_mass
    return np.asarray((vectors * np.minimum(values, 0.0)) @ vectors.T * root / root[:, None])


def accumulated_noise(A: Floats, density: Floats, seconds: float) -> Floats:
    """Covariance (n, n) of x after a time [s] if `x(0) = 0` and `dx/dt = A x + w`.

    The white noise w has the given density, (n, n). Source: [vanloan1978].
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
    """Covariance (3, 3) of position, velocity and poke due to the noise of the poke over dt [s].

    sd: standard deviation of the poke, stated as an acceleration [m/s²]; tau: correlation time of the poke [s]
    """
    s = 0.5 * dt * (LEGENDRE[0] + 1.0)
    gone = -np.expm1(-s / tau)
    g = np.array([tau * (s - tau * gone), tau * gone, 1.0 - gone])
    Q = (0.5 * dt * LEGENDRE[1] * (2.0 * sd**2 / tau) * g) @ g.T
    return 0.5 * (Q + Q.T)
