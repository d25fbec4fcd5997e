"""The tissue as a process model: its equations of motion, with an unknown poke on each marked node.

The state of the filter is the network's (positions, then velocities of the free nodes) followed by the poke on each
marked coordinate [N], node-major, and slow states [m], (dim,) each: bias of fixes, error of the target's offset.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynamics import (
    MassSpringNetwork,
    ParameterForces,
    ParameterUncertainty,
    Stepper,
    inverted_springs,
    state_matrix,
    stiffness_matrix,
)
from estimators.arrays import Floats
from estimators.filters.exponential import small_expm
from estimators.process.kernels import network_states, with_faded_pokes
from estimators.process.known_force import KnownForce

LONGEST_STEP = 1.0 / 120.0
"""Between two additions of noise [s]; chosen: `docs/decisions.md` has the error that it makes."""

LOOSE = 1e-11
"""Stiffness, by the largest, below which it is rounding: nothing resists."""

LEGENDRE = np.polynomial.legendre.leggauss(12)
"""Nodes and weights on (-1, 1): rounding is all that is left up to steps of twice the correlation time."""


@dataclass(frozen=True, slots=True)
class ForceMode:
    """The unknown forces in one mode.

    white: acceleration noise on every free node: what the model leaves out [m/s²/sqrt(Hz)]; choice
    poke: standard deviation of the poke on each marked node, by its mass [m/s²]; choice
    lasting_s: correlation time of the poke, a first-order Gauss-Markov process [s]; choice
    jolt: acceleration noise on each node that may be poked, beside `white`: blows [m/s²/sqrt(Hz)]; source: the mode
    only: place among the marked nodes of the only one that is poked so; None: all are [1]; source: the scene
    others: the pokes on the others then, in turn on one only or on all; source: the scene
    """

    white: float
    poke: float
    lasting_s: float
    jolt: float = 0.0
    only: int | None = None
    others: ForceMode | None = None

    def pokes(self, n_marked: int, dim: int) -> tuple[Floats, Floats]:
        """Standard deviation [m/s²] and correlation time [s] of the poke on each marked coordinate, (n_marked dim,)."""
        sd, lasting = np.full(n_marked * dim, self.poke), np.full(n_marked * dim, self.lasting_s)
        if self.only is not None and self.others is not None:
            beside = np.arange(n_marked * dim) // dim != self.only
            of_others, while_others = self.others.pokes(n_marked, dim)
            sd[beside], lasting[beside] = of_others[beside], while_others[beside]
        return sd, lasting


@dataclass(frozen=True, slots=True)
class FixBias:
    """What fixes of the target are off by together: sd [m] an axis, slowly varying over lasting_s [s]."""

    sd_m: float
    lasting_s: float = 60.0


class TissueModel:
    """Process model of a network whose marked nodes are poked by unknown forces.

    uncertainty: directions in which the network's constants are not known; each makes a column of the error
    n_calibration: directions in which the camera's calibration may be off; their columns come after those and are
        moved by no force of their own
    bias: of fixes of the target, if there are to be any
    offset_sd_m: of the error of the target's offset, a constant, an axis [m]; no state of it at 0
    hidden_share: of a poke, what may act on each free node that is not marked [1]; none at 0
    stiff: whether implicit steps and matrices move it whatever the network
    led: marked nodes that are led by these forces whatever the mode; raises ValueError where one is not marked
    led_rows: free coordinates of those nodes
    slow: rows of the slow states; bias_rows, offset_rows: of the bias and of the offset's error, empty where none is
    dim_x: the network's state, one poke for each coordinate of a node that is poked, and the slow states
    push: the known force that acts while points are moved, None where there is none
    """

    def __init__(
        self,
        network: MassSpringNetwork,
        marked: Sequence[str],
        *,
        uncertainty: ParameterUncertainty | None = None,
        bias: FixBias | None = None,
        offset_sd_m: float = 0.0,
        n_calibration: int = 0,
        led: tuple[Sequence[str], ForceMode] | None = None,
        hidden_share: float = 0.0,
        stiff: bool = False,
    ) -> None:
        self.network, self.stiff = network, stiff
        self.stepper = Stepper(network, LONGEST_STEP)
        hidden = [network.names[i] for i in network.free if network.names[i] not in marked] if hidden_share else []
        places = [network.coordinates(node) for node in [*marked, *hidden]]
        self.poked_rows = np.array([i for place in places for i in range(place.start, place.stop)], dtype=np.int64)
        n_fixed = network.n_state + len(self.poked_rows)
        slow = [(offset_sd_m, np.inf)] if offset_sd_m else []
        slow = slow if bias is None else [(bias.sd_m, bias.lasting_s), *slow]
        self.slow_sd, self._slow_s = (np.repeat([one[k] for one in slow], network.dim) for k in (0, 1))
        self.slow = slice(n_fixed, n_fixed + len(self.slow_sd))
        self.bias_rows = slice(n_fixed, n_fixed + (0 if bias is None else network.dim))
        self.dim_x, self.offset_rows = self.slow.stop, slice(self.bias_rows.stop, self.slow.stop)
        nodes: Sequence[str] = () if led is None else led[0]
        self._led_by = None if led is None else led[1]
        if unmarked := sorted(set(nodes) - set(marked)):
            raise ValueError(f"led nodes: expected marked ones, {', '.join(marked)}, found {', '.join(unmarked)}")
        self._led = np.repeat(np.array([node in nodes for node in [*marked, *hidden]], dtype=bool), network.dim)
        self.led_rows = self.poked_rows[self._led]
        self._share = np.repeat([1.0] * len(marked) + [hidden_share] * len(hidden), network.dim)
        self.pokes = slice(network.n_state, n_fixed)
        self.push: KnownForce | None = None
        self._asked: tuple[Sequence[ForceMode], tuple[Floats, Floats, Floats]] | None = None
        self._noises: tuple[float, Sequence[ForceMode], list[tuple[Floats, Floats]]] | None = None
        self.mass = np.repeat(network.masses[network.free], network.dim)
        self.uncertainty, self.n_calibration = uncertainty, n_calibration
        self.n_constants = 0 if uncertainty is None else len(uncertainty.directions)
        self.n_columns = self.n_constants + n_calibration
        self._forces = None if uncertainty is None else ParameterForces(network, uncertainty.parameters)

    def propagate(self, points: Floats, dt: float, mode: ForceMode) -> Floats:
        """Sigma points (n_points, dim_x) dt seconds later, each under its own poke, which fades meanwhile."""
        return self.propagate_each(points[None], dt, (mode,))[0]

    def propagate_each(self, points: Floats, dt: float, modes: Sequence[ForceMode]) -> Floats:
        """Sigma points of each mode, (n_modes, n_points, dim_x), dt seconds later."""
        return self._moved(np.ascontiguousarray(points), dt, modes)

    def _moved(self, points: Floats, dt: float, modes: Sequence[ForceMode], outside: Floats | None = None) -> Floats:
        n, half = self.network.n_state, self.network.n_state // 2
        lasting = self.noise_of(modes)[2][:, None]
        fade = np.exp(-dt / lasting)
        # of the poke at the start, the mean share over the step
        states, forces = network_states(points, (1.0 - fade) * lasting / dt, self.poked_rows, n)
        if outside is not None:
            forces += outside
        if self.push is not None:
            forces += self.push.forces(points[:, :, :n])
        ahead = self.stepper.advance(states.reshape(-1, n), dt, forces.reshape(-1, half))
        moved = with_faded_pokes(ahead, points, fade)
        if len(self.slow_sd):
            moved[:, :, self.slow] = self.slow_step(dt)[0] * points[:, :, self.slow]
        return moved

    def slow_step(self, dt: float) -> tuple[Floats, Floats]:
        """What is left of each slow state after dt [s], and the variance that is added [m²], (n_slow,) each."""
        return np.exp(-dt / self._slow_s), -np.expm1(-2.0 * dt / self._slow_s) * self.slow_sd**2

    def propagate_columns(self, means: Floats, columns: Floats, dt: float, modes: Sequence[ForceMode]) -> Floats:
        """Columns of the error dt [s] later: what each constant, one standard deviation away, makes of it.

        means (n_modes, dim_x), columns (n_modes, dim_x, n_columns). A constant with an error is a force beside the
        model's; the shift is taken as it is, not as a derivative. An error of the calibration is no force.
        """
        if not self.n_columns:
            return columns
        n = self.network.n_state
        base = self._moved(means[:, None], dt, modes)
        outside = np.zeros((len(means), columns.shape[2], n // 2))
        if self.n_constants:
            # of the start and the end of the step: held from the start on, it would lag by half a step
            ends = self.constant_forces(np.stack((means, base[:, 0])))
            outside[:, : self.n_constants] = 0.5 * (ends[0] + ends[1])
        points = np.ascontiguousarray(means[:, None] + columns.swapaxes(1, 2))
        moved = self._moved(points, dt, modes, outside)
        return np.ascontiguousarray((moved - base).swapaxes(1, 2))

    def constant_forces(self, means: Floats) -> Floats:
        """Forces on the n free coordinates that constants in error, each by one direction, make [N].

        means: (..., dim_x); returns (..., n_constants, n)
        """
        n = self.network.n_state
        if self._forces is None or self.uncertainty is None:
            return np.zeros((*means.shape[:-1], 0, n // 2))
        return np.asarray(self.uncertainty.directions @ self._forces(means[..., :n]))

    def noise_of(self, modes: Sequence[ForceMode]) -> tuple[Floats, Floats, Floats]:
        """`white_noise` of several modes, (n_modes, n_free dim), and `force_noise`, (n_modes, n_pokes) each.

        Those of the modes asked for last are kept.
        """
        if self._asked is None or self._asked[0] is not modes:
            white = np.array([self.white_noise(mode) for mode in modes])
            sd, lasting = (np.array(each) for each in zip(*map(self.force_noise, modes), strict=True))
            self._asked = modes, (white, sd, lasting)
        return self._asked[1]

    def force_noise(self, mode: ForceMode) -> tuple[Floats, Floats]:
        """Standard deviation [m/s²] and correlation time [s] of each poke in a mode, (n_pokes,)."""
        sd, lasting = mode.pokes(len(self._led) // self.network.dim, self.network.dim)
        if self._led_by is not None:
            sd[self._led], lasting[self._led] = self._led_by.poke, self._led_by.lasting_s
        return self._share * sd, lasting

    def white_noise(self, mode: ForceMode) -> Floats:
        """Acceleration noise of each free coordinate in a mode [m/s²/sqrt(Hz)], (n_free dim,)."""
        white = np.full(len(self.mass), mode.white)
        white[self.poked_rows] = np.hypot(white[self.poked_rows], self._share * mode.jolt)
        return white

    def turned(self, points: Floats) -> NDArray[np.bool_]:
        """Which sets of sigma points, (n_sets, n_points, dim_x), have a spring turned against the mean's, (n_sets,)."""
        return inverted_springs(self.network, points)

    def resting_columns(self, shape: Floats, held: Sequence[int] = ()) -> Floats:
        """What constants off along each direction make of a rest shape, (dim_x, n_columns).

        shape of all nodes [m], (n_nodes, dim); held: rows of the state whose places are known.
        """
        columns = np.zeros((self.dim_x, self.n_columns))
        if self._forces is None or self.uncertainty is None:
            return columns
        half = self.network.n_state // 2
        state = np.zeros(self.network.n_state)
        state[:half] = shape[self.network.free].ravel()
        others = np.setdiff1d(np.arange(half), np.asarray(held, dtype=int))
        forces = self.uncertainty.directions @ self._forces(state)
        K = stiffness_matrix(self.network, shape)
        own = K[np.ix_(others, others)]
        # nothing resists motion as a rigid body where no node is held: constants in error make none
        columns[others, : self.n_constants] = np.linalg.lstsq(own, forces[:, others].T, rcond=LOOSE)[0]
        return columns

    def noise(self, dt: float, mode: ForceMode) -> Floats:
        """Covariance that a step of dt [s] adds, (dim_x, dim_x), by the exact discretisation of each free coordinate.

        Springs and dashpots are left out of it: over a step of 1/240 s they change the phantom's by some 10 %, and the
        predicted covariance by 2 %, the same at every frame rate since steps are.
        """
        n, half = self.network.n_state, self.network.n_state // 2
        Q = np.zeros((self.dim_x, self.dim_x))
        _add_flight(Q, self.white_noise(mode) ** 2, dt)
        poke = np.array([_poke_noise(dt, sd, lasting) for sd, lasting in zip(*self.force_noise(mode), strict=True)])
        rows, mass = self.poked_rows, self.mass[self.poked_rows]
        places = (rows, half + rows, n + np.arange(len(rows)))
        scales = (np.ones(len(rows)), np.ones(len(rows)), mass)  # acceleration to force in the third only
        for a in range(3):
            for b in range(3):
                Q[places[a], places[b]] += scales[a] * poke[:, a, b] * scales[b]
        Q[self.slow, self.slow] = np.diag(self.slow_step(dt)[1])
        return Q

    def noise_of_modes(self, dt: float, modes: Sequence[ForceMode]) -> list[tuple[Floats, Floats]]:
        """As `noise`, (dim_x, dim_x), for each of these modes, and the part that is `ForceMode.white`.

        Those asked for last are kept. To a nanosecond: frames at one rate differ by rounding, and their noise does not.
        """
        key = round(dt, 9)
        if self._noises is None or self._noises[0] != key or self._noises[1] is not modes:
            by_mode = {mode: (self.noise(dt, mode), self.white_part(dt, mode)) for mode in set(modes)}
            self._noises = key, modes, [by_mode[mode] for mode in modes]
        return self._noises[2]

    def white_part(self, dt: float, mode: ForceMode) -> Floats:
        """Of `noise`, (dim_x, dim_x), what `ForceMode.white` makes."""
        Q = np.zeros((self.dim_x, self.dim_x))
        _add_flight(Q, np.full(len(self.mass), mode.white**2), dt)
        return Q

    def among_columns(self, shared: Floats) -> Floats:
        """What a calibration moves marks by, (m, n_calibration), after the columns of constants, which move none."""
        return np.hstack([np.zeros((len(shared), self.n_constants)), shared])

    def linearised(self, shape: Floats, mode: ForceMode) -> tuple[Floats, Floats]:
        """Matrix A and noise density of the augmented motion about a shape, each (dim_x, dim_x).

        Motions in which the shape is no stable rest, as where a link is compressed, go on at their speed instead of
        growing: a body leaves such a shape for the next rest, where a linear motion would go on to infinity.
        """
        n, half = self.network.n_state, self.network.n_state // 2
        A = np.zeros((self.dim_x, self.dim_x))
        A[:n, :n] = state_matrix(self.network, shape)
        A[half:n, :half] = _without_growth(A[half:n, :half], self.mass)
        density = np.zeros_like(A)
        density[range(half, n), range(half, n)] = self.white_noise(mode) ** 2
        for k, (row, sd, lasting) in enumerate(zip(self.poked_rows, *self.force_noise(mode), strict=True)):
            A[half + row, n + k] = 1.0 / self.mass[row]
            A[n + k, n + k] = -1.0 / lasting
            density[n + k, n + k] = 2.0 * (sd * self.mass[row]) ** 2 / lasting
        A[self.slow, self.slow] = np.diag(-1.0 / self._slow_s)
        density[self.slow, self.slow] = np.diag(2.0 * self.slow_sd**2 / self._slow_s)
        return A, density


def _add_flight(Q: Floats, white: Floats, dt: float) -> None:
    """Add what accelerations of these densities, (half,), make of places and velocities in a step of dt [s]."""
    q = np.arange(len(white))
    v = len(white) + q
    Q[q, q] += white * dt**3 / 3.0
    Q[v, v] += white * dt
    Q[q, v] += white * dt**2 / 2.0
    Q[v, q] += white * dt**2 / 2.0


def _without_growth(by_mass: Floats, mass: Floats) -> Floats:
    """-K / mass, (n, n), without the motions of negative stiffness; itself where there are none."""
    root = np.sqrt(mass)
    scaled = root[:, None] * by_mass / root
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    if values[-1] <= 0.0:
        return by_mass
    return np.asarray((vectors * np.minimum(values, 0.0)) @ vectors.T * root / root[:, None])


def accumulated_noise(A: Floats, density: Floats, seconds: float) -> Floats:
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


def _poke_noise(dt: float, sd: float, tau: float) -> Floats:
    """Covariance of place, velocity and poke by mass after dt [s] of a first-order Gauss-Markov force, (3, 3).

    sd: of the force by mass [m/s²]; tau: its correlation time [s]

    The integral of g g' over the age s of the noise, g what noise of that age has become: Gauss-Legendre.
    """
    s = 0.5 * dt * (LEGENDRE[0] + 1.0)
    gone = -np.expm1(-s / tau)
    g = np.array([tau * (s - tau * gone), tau * gone, 1.0 - gone])
    Q = (0.5 * dt * LEGENDRE[1] * (2.0 * sd**2 / tau) * g) @ g.T
    return 0.5 * (Q + Q.T)
