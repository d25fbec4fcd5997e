"""The tissue as a process model: assembled elements under unknown forces, with a discrepancy of displacement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from dynamics import MassSpringNetwork
from dynamics.elements import (
    Assembly,
    ForceElement,
    ReducedAssembly,
    Resistance,
    Span,
    Springs,
    Weight,
    smooth_shapes,
)
from dynamics.integration.rosenbrock import Rosenbrock
from dynamics.integration.stepping import Stepper
from estimators.arrays import Floats
from estimators.core.discrepancy import Discrepancy, factor, matern
from estimators.core.disturbances import Disturbances
from estimators.core.kernels import along_steps
from estimators.core.moments import add_noise, moved
from estimators.core.protocols import Transition
from estimators.core.sigma_points import by_sigma_points
from estimators.core.statics import Statics, StaticStates

LONGEST_S = 1.0 / 60.0
"""Longest step [s]; numerical."""

TOLERANCE, STEP_TOLERANCE = 1e-3, 1e-4
"""Error of a linearised frame, and of a step, by the body's extent [1]; numerical."""

FLAT = 1e-3
"""A body of less extent in a direction, by its largest, is thin there [1]; choice."""

PUSHED_S = 1.0
"""At the start the body was at rest so long before, and pushed since then [s]; choice."""

DISPLACED = 0.1
"""Displacement at the start, root of the mean square over nodes and axes, by the extent, at most [1]; choice."""

START_SHARE = 0.001
"""What each node may be displaced by itself at the start, by the extent, and its speed, by the extent a second [1];
choice."""

RANK = 20
"""Functions of a slow force at most, by each axis; numerical."""

GROWING = (0.5, 5.0, 30.0)
"""Rates of growth of the forces whose responses are the shapes of a reduced body [1/s]; numerical."""

LEFT_OUT = 1e-3
"""Displacement of a shape that is left out, by the extent, at most [1]; numerical."""

WEAK = 1e-2
"""Size of a force that is left out of those of its source, by the largest [1]; numerical."""

LARGE, FEWER = 30, 0.75
"""A body of more nodes than this is reduced if it has fewer shapes than nodes, by this factor [1]; choice."""

SOURCES = ("white", "short", "led", "slow", "discrepancy", "lasting")
"""Sources of noise, in the order of `Transition`; the last two are independent in each state."""


class TissueProcess:
    """The state of a network under unknown forces: position, velocity, force, discrepancy, and errors that last.

    Force is an acceleration of each marked node, then the slow field; the discrepancy is in standard deviations at
    level 1. A point of the body is its position and its discrepancy together: `places`.

    Parameters
    ----------
    network : MassSpringNetwork
        One without anchors is weightless: what holds it is not known.
    marked : sequence of str
        Free nodes that short forces may act on.
    led : sequence of str
        Those of the marked nodes that are led all the time.
    disturbances, discrepancy
        Priors.
    statics : Statics, optional
        Errors that last: of constants, calibration, fixes, the target's offset; none where it is not given.
    elements : sequence of ForceElement
        Those that act besides the network's own springs, resistance and weight.
    sigma_points : bool
        Whether the motion is linearised by sigma points, the unscented way, in place of its tangent; of a network
        without other elements.
    """

    def __init__(
        self,
        network: MassSpringNetwork,
        marked: Sequence[str],
        *,
        led: Sequence[str] = (),
        disturbances: Disturbances | None = None,
        discrepancy: Discrepancy | None = None,
        statics: Statics | None = None,
        elements: Sequence[ForceElement] = (),
        sigma_points: bool = False,
    ) -> None:
        self.network, self.disturbances = network, disturbances or Disturbances()
        self.discrepancy = discrepancy or Discrepancy()
        free, dim = network.free, network.dim
        places = network.positions[free]
        self.extent_m = float(np.linalg.norm(np.ptp(network.positions, axis=0)))
        acting: list[ForceElement] = [Springs.of_network(network), Resistance.of_network(network), *elements]
        if network.fixed.any():
            acting.append(Weight.of_network(network))
        assembly = Assembly(network.positions, free, acting)
        masses = np.repeat(network.masses[free], dim)
        self._raised = self.disturbances.raised(self.extent_m * _slowest(assembly, masses, places.ravel()))
        apart = np.linalg.norm(places[:, None] - places, axis=2)
        nodes = np.array([int(np.flatnonzero(free == network.index(name))[0]) for name in marked])
        is_led, each = np.array([name in led for name in marked]), np.eye(len(free))
        smooth = _shared(self._may_be_pushed(nodes)) * matern(apart, self.disturbances.smooth * self.extent_m)
        pushes = {"short": each[:, nodes[~is_led]], "led": each[:, nodes[is_led]], "slow": factor(smooth, RANK)}
        self.span = Span.whole(masses) if sigma_points else self._span(assembly, pushes)
        is_whole = self.span.matrix.shape[1] == assembly.n
        moving = assembly if is_whole else ReducedAssembly(assembly, self.span)
        basis, self._driving = self._forces(pushes)
        fading = np.where(self._driving == SOURCES.index("slow"), self.disturbances.slow_s, self.disturbances.short_s)
        self._stepper = Rosenbrock(moving, self.span.masses, basis, fading, STEP_TOLERANCE * self.extent_m)
        n_f = len(fading)
        field = self.discrepancy.field(places, network.positions[network.fixed])
        self._field = np.kron(field, np.eye(dim))
        n, n_d = moving.n, self._field.shape[1]
        bounds = np.cumsum([0, n, n, n_f, n_d])
        names = ("position", "velocity", "force", "discrepancy")
        self.parts = {name: slice(int(a), int(b)) for name, a, b in zip(names, bounds, bounds[1:], strict=False)}
        self._lasting, last = StaticStates(statics or Statics(), network, self.span), int(bounds[-1])
        self.parts |= {name: slice(last + own.start, last + own.stop) for name, own in self._lasting.parts.items()}
        self.n = last + self._lasting.n
        self.considered = last + np.flatnonzero(self._lasting.considered)
        self.rates = self.disturbances.rates
        self.tolerance = np.full(self.n, np.inf)
        self.tolerance[:n] = TOLERANCE * self.extent_m
        self._explicit = Stepper(network) if sigma_points else None
        self._basis, self._rates = basis * self.span.masses[:, None], 1.0 / fading
        self._start_cov = self._prior_of_motion()

    def _span(self, assembly: Assembly, pushes: Mapping[str, Floats]) -> Span:
        """All coordinates, or those of few shapes; pushes: accelerations of the nodes by source, (n_free, any)."""
        free, dim, usual = self.network.free, self.network.dim, Disturbances()
        masses = self.network.masses[free]
        if len(free) <= LARGE:
            return Span.whole(np.repeat(masses, dim))
        # At least the usual strengths: a needle's known force bends the body more than a weak prior expects
        least = {"short": usual.poke_m_s2, "led": usual.led_m_s2, "slow": usual.slow_m_s2[-1]}
        sd = {name: max(np.sqrt(self._strongest[SOURCES.index(name)]), self._raised * least[name]) for name in pushes}
        forces = np.hstack([sd[name] * masses[:, None] * push for name, push in pushes.items()])
        places, each = self.network.positions[free], np.eye(dim)
        shapes = smooth_shapes(assembly, places, masses, np.kron(forces, each), GROWING, LEFT_OUT * self.extent_m)
        if shapes.shape[1] > FEWER * len(free):
            return Span.whole(np.repeat(masses, dim))
        return Span.of_shapes(shapes, masses, dim)

    def _forces(self, pushes: Mapping[str, Floats]) -> tuple[Floats, NDArray[np.int64]]:
        """Accelerations of the coordinates (n, n_f) by the states of forces, and the source of each, (n_f,).

        The states of one source are independent and of equal variance, so they may be rotated to principal ones.
        """
        dim, columns, sources = self.network.dim, [], []
        for name, push in pushes.items():
            columns.append(_principal(self.span.onto[::dim, ::dim] @ push))
            sources += [SOURCES.index(name)] * columns[-1].shape[1]
        return np.asarray(np.kron(np.hstack(columns), np.eye(dim))), np.repeat(sources, dim)

    def _may_be_pushed(self, marked: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Free nodes on which slow forces act: all of a cable or cloth in space, else the marked ones."""
        extents = np.linalg.svd(self.network.positions - self.network.positions.mean(axis=0), compute_uv=False)
        is_thin = self.network.dim == 3 and extents[-1] < FLAT * extents[0]
        pushed = np.full(len(self.network.free), is_thin)
        pushed[marked] = True
        return pushed

    def _prior_of_motion(self) -> Floats:
        """Covariance of position and velocity at the start: at rest `PUSHED_S` before, pushed by all forces since."""
        n, moving = self.parts["position"].stop, self.parts["velocity"].stop
        state = np.zeros(self.n)
        state[:n] = self.coordinates(self.network.positions)
        strongest = self._strongest[None]
        before, transition = np.zeros((1, self.n, self.n)), self.linearize(state, PUSHED_S)
        self._set_forces(before[0], strongest[0])
        after = moved(before, transition.matrix)
        add_noise(after, transition, strongest)
        cov = after[0, :moving, :moving]
        V, own = self.span.matrix, self.span.onto @ self.span.onto.T
        spread = float(((V @ cov[:n, :n]) * V).sum()) / len(V)
        cov *= min(1.0, (DISPLACED * self.extent_m) ** 2 / spread)
        return np.asarray(cov + (START_SHARE * self.extent_m) ** 2 * np.kron(np.eye(2), own))

    @property
    def _strongest(self) -> Floats:
        """Variances of the sources in the mode of a poke and the strongest slow force."""
        return np.asarray(self.variances(0.0)[-2])

    def _set_forces(self, cov: Floats, variances: Floats) -> None:
        """Set the variances of all states that a source but white noise drives, by those of the sources."""
        by_name = dict(zip(SOURCES, variances, strict=True))
        for name, columns in self._columns().items():
            cov[columns, columns] = by_name[name]

    def coordinates(self, positions: Floats) -> Floats:
        """The coordinates of the state (n,) next to the positions of all nodes [m], (n_nodes, dim)."""
        return self.span.onto @ positions[self.network.free].ravel()

    def at(self, coordinates: Floats) -> Floats:
        """Places [m] of the free nodes, (..., n_free dim), at coordinates of the state (..., n); velocities alike."""
        return np.asarray(coordinates @ self.span.matrix.T)

    def node(self, name: str) -> Floats:
        """The map of a free node's place [m] by the state, (dim, n)."""
        matrix = np.zeros((self.network.dim, len(self.network.free) * self.network.dim))
        matrix[:, self.network.coordinates(name)] = np.eye(self.network.dim)
        return self.places(matrix)

    def places(self, matrix: Floats) -> Floats:
        """The map of a point [m] by the state, (dim, n), from its map by the free coordinates, (dim, n_free dim)."""
        rows = np.zeros((len(matrix), self.n))
        rows[:, self.parts["position"]] = matrix @ self.span.matrix
        rows[:, self.parts["discrepancy"]] = matrix @ self._field
        return rows

    def prior(self, level: float) -> tuple[Floats, Floats]:
        """At rest as drawn, under the forces of each mode: mean (n,), covariances (n_modes, n, n)."""
        mean = np.zeros(self.n)
        mean[self.parts["position"]] = self.coordinates(self.network.positions)
        moving = self.parts["velocity"].stop
        covs = np.zeros((len(self.rates), self.n, self.n))
        covs[:, :moving, :moving] = self._start_cov
        for variances, cov in zip(self.variances(level), covs, strict=True):
            self._set_forces(cov, variances)
        lasting = np.arange(self._behind, self.n)
        covs[:, lasting, lasting] = self._lasting.sd**2
        return mean, covs

    @property
    def _behind(self) -> int:
        """Where the states of errors that last begin."""
        return self.n - self._lasting.n

    def _columns(self) -> dict[str, NDArray[np.int64]]:
        """States that each source but white noise drives."""
        force = np.arange(self.parts["force"].start, self.parts["force"].stop)
        found = {name: force[self._driving == SOURCES.index(name)] for name in ("short", "led", "slow")}
        return found | {"discrepancy": np.arange(self.n)[self.parts["discrepancy"]]}

    def variances(self, level: float) -> Floats:
        """Variance of each source in each mode, (n_modes, n_sources).

        Of white noise [(m/s²)²/Hz], of forces [(m/s²)²], of the discrepancy in squares of its level [1]; 1 of errors
        that last.
        """
        d, raised = self.disturbances, self._raised
        calm, poke, led = d.short_m_s2
        rows = [
            (d.white, short, max(short, raised * led), raised * slow, level, 1.0)
            for slow in d.slow_m_s2
            for short in (calm, raised * poke, raised * led)
        ]
        return np.square(rows)

    def moved(self, state: Floats, dt: float) -> Floats:
        """The state (n,) after dt [s] without noise."""
        start, behind = self.parts["discrepancy"].start, self._behind
        last = self._stepper.moves(state[:start], dt, LONGEST_S, derivatives=False)[-1]
        lasting = self._lasting.fading(dt) * state[behind:]
        return np.concatenate([last.state, self._fading(dt) * state[start:behind], lasting])

    def moved_each(self, states: Floats, dt: float) -> Floats:
        """Coordinates and velocities of states (k, n) after dt [s], (k, 2 n_free dim), by explicit steps.

        Forces act by their mean over dt.
        """
        assert self._explicit is not None  # sigma points are passed through it alone
        moving = self.parts["velocity"].stop
        fading = -np.expm1(-dt * self._rates) / (dt * self._rates)
        forces = (states[:, self.parts["force"]] * fading) @ self._basis.T
        return self._explicit.advance(states[:, :moving], dt, forces)

    def linearize(self, state: Floats, dt: float, cov: Floats | None = None) -> Transition:
        """The motion over dt [s], linearised step by step along it, or by sigma points of a covariance (n, n)."""
        found = self._along(state, dt)
        if cov is None or self._explicit is None:
            return found
        return by_sigma_points(
            found, state, cov, self.parts["velocity"].stop, lambda points: self.moved_each(points, dt)
        )

    def _along(self, state: Floats, dt: float) -> Transition:
        moving, start = self.parts["velocity"].stop, self.parts["discrepancy"].start
        moves = self._stepper.moves(state[:start], dt, LONGEST_S)
        motion, force, noises = along_steps(
            np.array([move.by_state for move in moves]),
            np.array([move.fading for move in moves]),
            np.array([move.step_s for move in moves]),
            self._driving - 1,
            len(SOURCES) - 3,
            self.span.white,
        )
        fading, behind = np.full(self.n, self._fading(dt)), self._behind
        fading[moving:start], fading[behind:] = force, self._lasting.fading(dt)
        matrix = np.diag(fading)
        matrix[:moving, :start] = motion
        constants = self.parts.get("constants")
        if constants is not None:
            matrix[:moving, constants] = self._lasting.moved_by_constants(state[:moving], moves)
        independent = np.zeros((2, self.n))
        independent[0, start:behind] = self.fresh(dt)
        independent[1, behind:] = (1.0 - fading[behind:] ** 2) * self._lasting.sd**2
        mean = np.concatenate([moves[-1].state, fading[start:] * state[start:]])
        return Transition(mean, matrix, noises, independent)

    def _fading(self, dt: float) -> float:
        return float(np.exp(-dt / self.discrepancy.lasting_s))

    def fresh(self, dt: float) -> float:
        """Share of the discrepancy's variance that is new after dt [s]."""
        return 1.0 - self._fading(dt) ** 2


def _principal(columns: Floats) -> Floats:
    """Columns (n, any) of independent coefficients of one variance, in as few that have the same effect.

    Columns that all count remain as they are.
    """
    vectors, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    kept = sizes > WEAK * sizes.max(initial=0.0)
    return columns if kept.sum() == columns.shape[1] else np.asarray(vectors[:, kept] * sizes[kept])


def _shared(pushed: NDArray[np.bool_]) -> Floats:
    return np.outer(pushed, pushed).astype(float)


def _slowest(assembly: Assembly, masses: Floats, q: Floats) -> float:
    """Square of the slowest angular frequency that is no free motion of the body [1/s²]."""
    K = assembly.tangents(q, np.zeros_like(q))[0].toarray()
    values = eigh(K, np.diag(masses), eigvals_only=True)
    return float(values[values > 1e-6 * values[-1]][0])
