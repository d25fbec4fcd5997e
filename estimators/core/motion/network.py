"""Motion of a network of springs and other elements. A large network is reduced to a few deformation shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from dynamics import MassSpringNetwork, ParameterUncertainty
from dynamics.elements import (
    Assembly,
    ForceElement,
    ReducedAssembly,
    Resistance,
    Span,
    Springs,
    Weight,
    matern,
    smooth_shapes,
)
from dynamics.forces.parameters import ParameterForces
from dynamics.integration.rosenbrock import Move, Rosenbrock, along
from dynamics.integration.stepping import Stepper
from estimators.arrays import Floats
from estimators.core.discrepancy import factor
from estimators.core.disturbances import Disturbances
from estimators.core.motion.model import SOURCES, Along

LONGEST_S = 1.0 / 60.0
"""Longest integration step [s]; numerical."""

STEP_TOLERANCE = 1e-4
"""Largest accepted error of an integration step, relative to the body's extent [1]; numerical."""

FLAT = 1e-3
"""A body is flat if its smallest extent, relative to its largest, is below this number [1]; choice."""

RANK = 20
"""Largest number of basis functions of a slow force for each axis; numerical."""

GROWING = (0.5, 5.0, 30.0)
"""Growth rates of exponential test forces [1/s]; numerical. A reduced body has the shapes that these forces cause."""

LEFT_OUT = 2e-3
"""A shape is omitted if it contributes at most this displacement, relative to the body's extent [1]; numerical."""

WEAK = 1e-2
"""Forces below this share of the largest force from the same source are omitted [1]; numerical."""

LARGE, FEWER = 30, 0.75
"""Only a body with more than LARGE free nodes is reduced, to at most FEWER shapes per free node [1]; choice."""


class NetworkMotion:
    """Motion of a network, see `Motion`. The parameters are those of `TissueProcess`."""

    def __init__(
        self,
        network: MassSpringNetwork,
        marked: Sequence[str],
        disturbances: Disturbances,
        *,
        led: Sequence[str] = (),
        uncertainty: ParameterUncertainty | None = None,
        elements: Sequence[ForceElement] = (),
        sigma_points: bool = False,
    ) -> None:
        self._network, self._uncertainty, self.is_linear = network, uncertainty, False
        free, dim = network.free, network.dim
        places = network.positions[free]
        self.extent_m = float(np.linalg.norm(np.ptp(network.positions, axis=0)))
        acting: list[ForceElement] = [Springs.of_network(network), Resistance.of_network(network), *elements]
        if network.fixed.any():
            acting.append(Weight.of_network(network))
        assembly = Assembly(network.positions, free, acting)
        masses = np.repeat(network.masses[free], dim)
        self.raised = disturbances.raised(self.extent_m * _slowest(assembly, masses, places.ravel()))
        apart = np.linalg.norm(places[:, None] - places, axis=2)
        nodes = np.array([int(np.flatnonzero(free == network.index(name))[0]) for name in marked])
        is_led, each = np.array([name in led for name in marked]), np.eye(len(free))
        may_be_pushed = self._may_be_pushed(nodes).astype(float)
        smooth = np.outer(may_be_pushed, may_be_pushed) * matern(apart, disturbances.smooth * self.extent_m)
        slow = np.column_stack([factor(smooth, RANK), np.ones(len(free))])  # a field and a uniform force
        pushes = {"short": each[:, nodes[~is_led]], "led": each[:, nodes[is_led]], "slow": slow}
        self.span = Span.whole(masses) if sigma_points else self._span(assembly, pushes, disturbances)
        is_whole = self.span.matrix.shape[1] == assembly.n
        moving = assembly if is_whole else ReducedAssembly(assembly, self.span)
        basis, self.driving = self._forces(pushes)
        self.fading_s = np.where(self.driving == SOURCES.index("slow"), disturbances.slow_s, disturbances.short_s)
        self.force_cov = np.eye(len(self.driving))
        self.by_force = np.zeros((assembly.n, len(self.driving)))
        self._stepper = Rosenbrock(moving, self.span.masses, basis, self.fading_s, STEP_TOLERANCE * self.extent_m)
        self._explicit = Stepper(network) if sigma_points else None
        self._basis = basis * self.span.masses[:, None]
        self._by_constants = None if uncertainty is None else ParameterForces(network, uncertainty.parameters)

    def _span(self, assembly: Assembly, pushes: Mapping[str, Floats], disturbances: Disturbances) -> Span:
        """Map from coordinates to node positions. For a large body, few shapes span its responses to `pushes`."""
        free, dim, usual = self._network.free, self._network.dim, Disturbances()
        masses = self._network.masses[free]
        if len(free) <= LARGE:
            return Span.whole(np.repeat(masses, dim))
        # A needle's known force may bend the body more than a weak prior expects: the default strengths are a minimum
        least = {"short": usual.poke_m_s2, "led": usual.led_m_s2, "slow": usual.slow_m_s2[-1]}
        own = disturbances.strongest(self.raised)
        sd = {name: max(own[name], self.raised * least[name]) for name in pushes}
        forces = np.hstack([sd[name] * masses[:, None] * push for name, push in pushes.items()])
        places, each = self._network.positions[free], np.eye(dim)
        shapes = smooth_shapes(
            assembly, places, masses, np.asarray(np.kron(forces, each)), GROWING, LEFT_OUT * self.extent_m
        )
        if shapes.shape[1] > FEWER * len(free):
            return Span.whole(np.repeat(masses, dim))
        return Span.of_shapes(shapes, masses, dim)

    def _forces(self, pushes: Mapping[str, Floats]) -> tuple[Floats, NDArray[np.int64]]:
        """Acceleration of each coordinate (row) by each unit force (column), (n, n_f); index in `SOURCES`, (n_f,)."""
        dim, columns, sources = self._network.dim, [], []
        for name, push in pushes.items():
            columns.append(principal(self.span.onto[::dim, ::dim] @ push))
            sources += [SOURCES.index(name)] * columns[-1].shape[1]
        return np.asarray(np.kron(np.hstack(columns), np.eye(dim))), np.repeat(sources, dim)

    def _may_be_pushed(self, marked: NDArray[np.int64]) -> NDArray[np.bool_]:
        """For each free node, whether slow forces act on it: yes if it is marked, or if the body is flat and in 3-D."""
        network = self._network
        extents = np.linalg.svd(network.positions - network.positions.mean(axis=0), compute_uv=False)
        is_thin = network.dim == 3 and extents[-1] < FLAT * extents[0]
        pushed = np.full(len(network.free), is_thin)
        pushed[marked] = True
        return pushed

    def moved(self, state: Floats, dt: float) -> Floats:
        """State after dt [s] without noise: n coordinates, n velocities, n_f forces, (2 n + n_f,)."""
        return self._stepper.moves(state, dt, LONGEST_S, derivatives=False)[-1].state

    def along(self, state: Floats, dt: float) -> Along:
        """Motion from a state (2 n + n_f,) over dt [s], linearised at each step of the trajectory."""
        moves = self._stepper.moves(state, dt, LONGEST_S)
        motion, fading, noises = along(moves, self.driving - 1, len(SOURCES) - 3, self.span.white)
        by_constants = self._moved_by_constants(state[: len(motion)], moves)
        return Along(moves[-1].state, motion, fading, noises, by_constants)

    def moved_each(self, states: Floats, dt: float) -> Floats:
        """Coordinates and velocities (k, 2 n) after dt [s], by explicit steps from k states (k, 2 n + n_f or more)."""
        assert self._explicit is not None  # only sigma points call this
        moving, rates = 2 * len(self.span.masses), 1.0 / self.fading_s
        mean = -np.expm1(-dt * rates) / (dt * rates)
        forces = states[:, moving : moving + len(rates)] * mean
        return self._explicit.advance(states[:, :moving], dt, forces @ self._basis.T)

    def _moved_by_constants(self, start: Floats, moves: Sequence[Move]) -> Floats:
        """`Along.by_constants`, (2 n, any), for a motion from `start` in the steps `moves`."""
        moving = len(start)
        if self._by_constants is None:
            return np.zeros((moving, 0))
        pushes = self._accelerations(np.stack([start, *(move.state[:moving] for move in moves)]))
        return _pushed(moves, 0.5 * (pushes[:-1] + pushes[1:]))

    def pushed(self, state: Floats, dt: float, accelerations: Floats) -> Floats:
        """Change of coordinates and velocities over dt [s], (2 n, k), due to constant accelerations [m/s²], (n, k)."""
        moves = self._stepper.moves(state, dt, LONGEST_S)
        return _pushed(moves, [accelerations] * len(moves))

    def _accelerations(self, states: Floats) -> Floats:
        """Accelerations per standard deviation of each error of the constants [m/s²], (..., n, any)."""
        assert self._by_constants is not None  # else there are no constants
        assert self._uncertainty is not None
        V, masses = self.span.matrix, self.span.masses
        nodes = np.concatenate([states[..., : len(masses)] @ V.T, states[..., len(masses) :] @ V.T], axis=-1)
        forces = self._uncertainty.directions @ self._by_constants(nodes)
        return np.asarray(forces @ V / masses).swapaxes(-1, -2)


def _pushed(moves: Sequence[Move], accelerations: Sequence[Floats] | Floats) -> Floats:
    """Change of coordinates and velocities after all steps, (2 n, k), by constant accelerations (n, k) in each step."""
    n, k = accelerations[0].shape
    columns = np.zeros((2 * n, k))
    for move, own in zip(moves, accelerations, strict=True):
        columns = move.by_state[:, : 2 * n] @ columns + move.pushed(own)
    return columns


def principal(columns: Floats) -> Floats:
    """Reduce the given columns L (n, any) to fewer columns M for which `M M'` nearly equals `L L'`."""
    vectors, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    kept = sizes > WEAK * sizes.max(initial=0.0)
    return columns if kept.sum() == columns.shape[1] else np.asarray(vectors[:, kept] * sizes[kept])


def _slowest(assembly: Assembly, masses: Floats, q: Floats) -> float:
    """Square of the body's lowest angular frequency [1/s²]. Rigid motions, which have frequency 0, do not count."""
    K = assembly.tangents(q, np.zeros_like(q))[0].toarray()
    values = eigh(K, np.diag(masses), eigvals_only=True)
    return float(values[values > 1e-6 * values[-1]][0])
