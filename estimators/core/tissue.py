"""Process model of a tissue: motion under unknown forces, discrepancy of the model, constant errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dynamics import MassSpringNetwork
from dynamics.elements import ForceElement, Span
from estimators.arrays import Floats
from estimators.core.discrepancy import Discrepancy
from estimators.core.disturbances import Disturbances
from estimators.core.moments import add_noise, moved
from estimators.core.motion import SOURCES, ContinuumMotion, Motion, NetworkMotion, by_sigma_points
from estimators.core.protocols import Transition
from estimators.core.statics import Statics, StaticStates

TOLERANCE = 1e-3
"""Largest linearisation error in a frame, relative to the body's extent [1]; numerical."""

PUSHED_S = 1.0
"""The prior assumes that unknown forces have acted on a body at rest for this time [s]; choice."""

DISPLACED = 0.1
"""Largest prior standard deviation of the nodes' displacements, relative to the body's extent [1]; choice."""

START_SHARE = 0.001
"""Standard deviation of the displacement [1] and the velocity [1/s] that the prior adds to each node independently,
relative to the body's extent; choice."""


class TissueProcess:
    """Process model of a network under unknown forces.

    The state contains positions, velocities, forces, the discrepancy and constant errors (see `Statics`). Short forces
    are accelerations of marked nodes. Slow forces are coefficients of a smooth acceleration field. For a continuum, see
    `Disturbances`. The discrepancy is the displacement that the motion leaves out. The discrepancy's states are
    coefficients of basis functions [1].

    Parameters
    ----------
    network : MassSpringNetwork
        If it has no anchors, gravity is ignored, because the support is not known.
    marked : sequence of str
        Free nodes on which short forces may act, see `Disturbances`.
    led : sequence of str
        Marked nodes that an external force, such as a gripper's, may drag at any time.
    disturbances, discrepancy
        Priors of the unknown forces and of the discrepancy.
    statics : Statics, optional
        Priors of constant errors; default: no constant errors.
    elements : sequence of ForceElement
        Elements in addition to the network's springs, resistance and weight.
    sigma_points : bool
        Whether the motion is linearised by sigma points instead of derivatives. Not possible with `elements`.
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
        self.network = network
        self.disturbances = replace(disturbances or Disturbances(), n_marked=len(marked))
        self.discrepancy = discrepancy or Discrepancy()
        uncertainty = None if statics is None else statics.uncertainty
        self.motion: Motion
        if network.continuum is not None:
            self.motion = ContinuumMotion(network, self.disturbances, uncertainty)
        else:
            self.motion = NetworkMotion(
                network,
                marked,
                self.disturbances,
                led=led,
                uncertainty=uncertainty,
                elements=elements,
                sigma_points=sigma_points,
            )
        self._by_points = self.motion if sigma_points and isinstance(self.motion, NetworkMotion) else None
        self.extent_m = self.motion.extent_m
        field = self.discrepancy.field(network.positions[network.free], network.positions[network.fixed])
        self._field, self.left_out_m2 = np.kron(field[0], np.eye(network.dim)), field[1]
        n, n_f, n_d = self.span.matrix.shape[1], len(self.motion.driving), self._field.shape[1]
        bounds = np.cumsum([0, n, n, n_f, n_d])
        names = ("position", "velocity", "force", "discrepancy")
        self.parts = {name: slice(int(a), int(b)) for name, a, b in zip(names, bounds, bounds[1:], strict=False)}
        self._lasting, last = StaticStates(statics or Statics(), network.dim), int(bounds[-1])
        self.parts |= {name: slice(last + own.start, last + own.stop) for name, own in self._lasting.parts.items()}
        self.n = last + self._lasting.n
        self.considered = last + np.flatnonzero(self._lasting.considered)
        self.rates = self.disturbances.rates
        self.tolerance = np.full(self.n, np.inf)
        if not self.motion.is_linear:
            self.tolerance[:n] = TOLERANCE * self.extent_m
        self._start_cov = self._prior_of_motion()

    @property
    def span(self) -> Span:
        """Map from the state's coordinates to the positions of the free nodes."""
        return self.motion.span

    def _prior_of_motion(self) -> Floats:
        """Prior covariance of position and velocity, after a body at rest was pushed by forces for `PUSHED_S`."""
        n, moving = self.parts["position"].stop, self.parts["velocity"].stop
        state = np.zeros(self.n)
        state[:n] = self.coordinates(self.network.positions)
        strongest = self.variances(0.0)[[self.disturbances.strongest_mode]]
        before, transition = np.zeros((1, self.n, self.n)), self.linearize(state, PUSHED_S)
        self._set_forces(before[0], strongest[0])
        after = moved(before, transition.matrix)
        add_noise(after, transition, strongest)
        cov = after[0, :moving, :moving]
        V, own = self.span.matrix, self.span.independent
        spread = float(((V @ cov[:n, :n]) * V).sum()) / len(V)
        cov *= min(1.0, (DISPLACED * self.extent_m) ** 2 / spread)
        return np.asarray(cov + (START_SHARE * self.extent_m) ** 2 * np.kron(np.eye(2), own))

    def _set_forces(self, cov: Floats, variances: Floats) -> None:
        """Write the prior covariance of forces and discrepancy into `cov`, (n, n), for given source variances."""
        force = self.parts["force"]
        cov[force, force] = variances[self.motion.driving] * self.motion.force_cov
        displaced = np.arange(self.n)[self.parts["discrepancy"]]
        cov[displaced, displaced] = variances[SOURCES.index("discrepancy")]

    def coordinates(self, positions: Floats) -> Floats:
        """Coordinates (n,) that best fit given positions of all nodes [m], (n_nodes, dim)."""
        return self.span.coordinates(positions[self.network.free].ravel())

    def at(self, coordinates: Floats) -> Floats:
        """Positions of the free nodes without `Motion.by_force` [m], (..., n_free dim), from coordinates (..., n).

        Also maps velocities.
        """
        return np.asarray(coordinates @ self.span.matrix.T)

    def positions(self, state: Floats) -> Floats:
        """Positions of the free nodes without the discrepancy [m], (n_free dim,), from a state (n,)."""
        return self.at(state[self.parts["position"]]) + self.motion.by_force @ state[self.parts["force"]]

    def node(self, name: str) -> Floats:
        """Matrix (dim, n) that maps the state to the position of a free node [m]."""
        matrix = np.zeros((self.network.dim, len(self.network.free) * self.network.dim))
        matrix[:, self.network.coordinates(name)] = np.eye(self.network.dim)
        return self.places(matrix)

    def places(self, matrix: Floats) -> Floats:
        """Matrix (dim, n) that maps the state to the position of a point [m].

        matrix: maps the positions of the free nodes to the position of the point, (dim, n_free dim)
        """
        rows = np.zeros((len(matrix), self.n))
        rows[:, self.parts["position"]] = matrix @ self.span.matrix
        rows[:, self.parts["force"]] = matrix @ self.motion.by_force
        rows[:, self.parts["discrepancy"]] = matrix @ self._field
        return rows

    def prior(self, level: float) -> tuple[Floats, Floats]:
        """Prior mean (n,), which is rest at `network.positions`, and prior covariance in each mode, (n_modes, n, n)."""
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
        """Index of the first state of constant errors."""
        return self.n - self._lasting.n

    def variances(self, level: float) -> Floats:
        """Variance of each source of noise in each mode, (n_modes, n_sources).

        The unit is (m/s²)²/Hz for white noise and (m/s²)² for forces.
        level: standard deviation of the discrepancy, relative to the body's extent [1]
        """
        rows = [(*strengths, level, 1.0) for strengths in self.disturbances.by_mode(self.motion.raised)]
        return np.square(rows)

    def moved(self, state: Floats, dt: float) -> Floats:
        """Next state (n,) after dt [s] without noise."""
        start, behind = self.parts["discrepancy"].start, self._behind
        lasting = self._lasting.fading(dt) * state[behind:]
        return np.concatenate([self.motion.moved(state[:start], dt), self._fading(dt) * state[start:behind], lasting])

    def pushed(self, state: Floats, dt: float, forces: Floats) -> Floats:
        """Change of the state over dt [s], (n, k), by each column of constant forces [N], (n_free dim, k)."""
        masses = np.repeat(self.network.masses[self.network.free], self.network.dim)
        moving, found = self.parts["velocity"].stop, np.zeros((self.n, forces.shape[1]))
        accelerations = self.span.onto @ (forces / masses[:, None])
        found[:moving] = self.motion.pushed(state[: self.parts["discrepancy"].start], dt, accelerations)
        return found

    def linearize(self, state: Floats, dt: float, cov: Callable[[], Floats] | None = None) -> Transition:
        """Linearise the transition over dt [s] about a state (n,).

        cov: returns the covariance of the state, (n, n). It is called only if sigma points linearise the motion.
        """
        found = self._along(state, dt)
        by, m = self._by_points, self.parts["velocity"].stop
        if cov is None or by is None:
            return found
        return by_sigma_points(found, state, cov(), m, lambda points: by.moved_each(points, dt))

    def _along(self, state: Floats, dt: float) -> Transition:
        moving, start, behind = self.parts["velocity"].stop, self.parts["discrepancy"].start, self._behind
        found = self.motion.along(state[:start], dt)
        fading = np.full(self.n, self._fading(dt))
        fading[moving:start], fading[behind:] = found.fading, self._lasting.fading(dt)
        matrix = np.diag(fading)
        matrix[:moving, :start] = found.motion
        if "constants" in self.parts:
            matrix[:moving, self.parts["constants"]] = found.by_constants
        independent = np.zeros((2, self.n))
        independent[0, start:behind] = self.fresh(dt)
        independent[1, behind:] = (1.0 - fading[behind:] ** 2) * self._lasting.sd**2
        mean = np.concatenate([found.mean, fading[start:] * state[start:]])
        return Transition(mean, matrix, found.noises, independent)

    def _fading(self, dt: float) -> float:
        return float(np.exp(-dt / self.discrepancy.lasting_s))

    def fresh(self, dt: float) -> float:
        """Share of the discrepancy's variance that arose in the last dt [s]."""
        return 1.0 - self._fading(dt) ** 2
