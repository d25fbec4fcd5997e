"""Motion of a continuum in closed form: damped vibration modes under forces that decay.

A vibration mode with angular frequency w and damping c follows `x'' + c x' + w² x = f`. Its responses to an impulse and
to a force `exp(-a t)` are sums of exponentials, so a step of any length is exact. Omitted modes respond statically:
each force displaces the nodes by the residual flexibility of the modes [macneal1971]. The force on the whole body is
smooth in time: it is the difference of two states that decay at different rates and have the same noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from dynamics import MassSpringNetwork, ParameterUncertainty
from dynamics.elements import Span
from estimators.arrays import Floats
from estimators.core.disturbances import Disturbances
from estimators.core.motion.model import SOURCES, Along

Exponents = NDArray[np.complex128]

APART = 1e-3
"""Smallest difference between two exponents in the response of a mode to a force [1/s]; numerical."""

LEFT_OUT = 3e-5
"""Largest share of the points' mean square displacement that omitted surface forces may cause [1]; numerical."""

WALL, WALL_S = 0.3, 1.0
"""A driven wall's acceleration noise, relative to `Disturbances.white` [1], and its velocity's correlation time [s];
choice."""

WALL_START = 30.0
"""Prior standard deviation of a driven wall's motion at the start, relative to that of other modes [1]; choice."""

SAME_S = 1e-9
"""Largest difference of frame intervals that counts as a rounding error [s]; numerical."""

NODES, PANEL = 16, 8.0
"""Gauss quadrature: nodes per panel, and longest panel in time constants of the integrand [1]; numerical."""

FIXED = 1e-6
"""Standard deviation assigned to coordinate 0 [1]; numerical. The coordinate is constant, but no variance may be 0."""


class ContinuumSpan(Span):
    """Map from coordinates to positions. Coordinate 0 scales `network.positions`; the others scale vibration modes."""

    @classmethod
    def of(cls, network: MassSpringNetwork) -> ContinuumSpan:
        """Make the map of a continuum. Coordinate 0 is always 1; the others are the amplitudes of modes [m]."""
        solid = network.continuum
        assert solid is not None  # the caller checks it
        drawn = network.positions[network.free].reshape(-1, 1)
        masses = np.repeat(network.masses[network.free], network.dim)
        r = len(solid.rates)
        white = np.r_[0.0, np.where(np.isinf(solid.masses), WALL, np.sqrt(network.dim / r))]
        onto = np.vstack([np.zeros((1, len(drawn))), solid.shapes.T * masses / solid.masses[:, None]])
        matrix = np.hstack([drawn, solid.shapes])
        return cls(matrix, onto, np.r_[solid.mass, solid.masses], white)

    def coordinates(self, places: Floats) -> Floats:
        """Coordinates (n,) that best fit positions of the free nodes [m], (n_full,)."""
        return np.r_[1.0, np.linalg.lstsq(self.matrix[:, 1:], places - self.matrix[:, 0], rcond=None)[0]]

    @property
    def independent(self) -> Floats:
        """Diagonal covariance, (n, n): `FIXED**2` for coordinate 0, `WALL_START**2` for a wall, else `white**2`."""
        sd = np.where(np.isinf(self.masses[1:]), WALL_START, self.white[1:])
        return np.diag(np.r_[FIXED**2, sd**2])


class ContinuumMotion:
    """Motion of a continuum, see `Motion`.

    Parameters
    ----------
    network : MassSpringNetwork
        Network with a continuum.
    disturbances : Disturbances
        Prior of the forces. Each strength is a force divided by the mass of the body.
    uncertainty : ParameterUncertainty, optional
        Uncertainty of the tissues' stiffness.
    """

    def __init__(
        self, network: MassSpringNetwork, disturbances: Disturbances, uncertainty: ParameterUncertainty | None = None
    ) -> None:
        solid = network.continuum
        assert solid is not None  # the caller checks it
        self.is_linear = True
        self.extent_m, self.span = solid.extent_m, ContinuumSpan.of(network)
        held = solid.rates[solid.rates > 1e-6 * solid.rates.max()]
        usual = Disturbances(bent=disturbances.bent)
        self.raised = usual.raised(self.extent_m * float(held.min()), least=0.0)
        static = solid.shapes @ (solid.forces / np.maximum(solid.rates, held.min())[:, None]) + solid.omitted
        fields = block_diag(np.eye(network.dim), _effective(static[:, network.dim :]))
        force = np.r_[: network.dim, : network.dim, network.dim : fields.shape[1]]  # to which each state contributes
        n_states = network.dim, network.dim, fields.shape[1] - network.dim
        sign = np.repeat([1.0, -1.0, 1.0], n_states)
        self._basis, self.by_force = sign * (solid.forces @ fields)[:, force], sign * (solid.omitted @ fields)[:, force]
        self.driving = np.repeat([SOURCES.index(source) for source in ("short", "short", "slow")], n_states)
        self.fading_s = np.repeat([disturbances.short_s, disturbances.smooth_s, disturbances.slow_s], n_states)
        shared = 1.0 / (1.0 / self.fading_s[:, None] + 1.0 / self.fading_s)
        noise = np.eye(fields.shape[1])[force]
        signed = sign[:, None] * noise
        self._noise = noise / np.sqrt(np.diag(signed.T @ shared @ signed))
        self.force_cov = self._noise @ self._noise.T * shared
        damping = np.where(np.isinf(solid.masses), 1.0 / WALL_S, solid.damping)
        root = np.sqrt((0.25 * damping**2 - solid.rates).astype(complex))
        root = np.where(np.abs(root) < APART, APART, root)
        self._roots = np.stack([-0.5 * damping + root, -0.5 * damping - root])
        self._last: tuple[float, Floats, Floats, Floats] | None = None  # reused while frame intervals are equal
        self._constants = None
        if uncertainty is not None:
            each = np.zeros((len(uncertainty.parameters), len(solid.rates), len(solid.rates)))
            for k, parameter in enumerate(uncertainty.parameters):
                each[k] = solid.by_tissue[parameter.index]
            self._constants = -np.tensordot(uncertainty.directions, each, 1)

    def moved(self, state: Floats, dt: float) -> Floats:
        """State after dt [s] without noise: n coordinates, n velocities, n_f forces, (2 n + n_f,)."""
        motion, fading = self._motion(dt)
        return np.concatenate([motion @ state, fading * state[len(motion) :]])

    def along(self, state: Floats, dt: float) -> Along:
        """Motion from a state (2 n + n_f,) over dt [s]. The linearisation is exact."""
        if self._last is None or abs(self._last[0] - dt) > SAME_S:
            self._last = dt, *self._motion(dt), self._noises(dt, len(state))
        _, motion, fading, noises = self._last
        mean = np.concatenate([motion @ state, fading * state[len(motion) :]])
        return Along(mean, motion, fading, noises, self._moved_by_constants(state, mean, dt))

    def _impulse(self, t: Floats) -> tuple[Floats, Floats]:
        """Displacement [s] and velocity [1] of each mode, (n_modes, k), at times t (k,) after a unit impulse."""
        one, other = self._roots[..., None]
        grown = np.exp(one * t), np.exp(other * t)
        return ((grown[0] - grown[1]) / (one - other)).real, ((one * grown[0] - other * grown[1]) / (one - other)).real

    def _pushed(self, rate: float) -> tuple[Exponents, Exponents, Exponents]:
        """Response of each vibration mode to a force `exp(-rate t)`: `sum over p of factor_p exp(rate_p t)`.

        Returns factors of the displacement [s²], factors of the velocity [s], rates [1/s], (3, n_modes) each.
        """
        one, other = self._roots
        a = np.where(np.minimum(np.abs(one + rate), np.abs(other + rate)) < APART, rate + 2.0 * APART, rate)
        shares = np.stack([1.0 / ((one - other) * (one + a)), -1.0 / ((one - other) * (other + a))])
        moved = np.stack([*shares, -shares.sum(axis=0)])
        rates = np.stack([one, other, -a.astype(complex)])
        return moved, moved * rates, rates

    def _motion(self, dt: float) -> tuple[Floats, Floats]:
        """Matrices of a step of dt [s]: `Along.motion`, (2 n, 2 n + n_f), and decay factor of each force, (n_f,)."""
        r, end = self._roots.shape[1], np.array([dt])
        n, x = 1 + r, np.arange(1, 1 + r)
        by_x, by_v = self._impulse(end)
        damping, rates = -self._roots.sum(axis=0).real, self._roots.prod(axis=0).real
        motion = np.zeros((2 * n, 2 * n + len(self.driving)))
        motion[0, 0] = 1.0
        motion[n, n] = 1.0
        motion[x, x], motion[x, n + x] = by_v[:, 0] + damping * by_x[:, 0], by_x[:, 0]
        motion[n + x, x], motion[n + x, n + x] = -rates * by_x[:, 0], by_v[:, 0]
        motion[:, 2 * n :] = self._driven(end)[: 2 * n, :, 0]
        return motion, np.exp(-dt / self.fading_s)

    def _driven(self, t: Floats) -> Floats:
        """State at times t [s], (2 n + n_f, n_f, len(t)), after a start at rest with a unit of each force state."""
        n, n_f = 1 + self._roots.shape[1], len(self.fading_s)
        states = np.zeros((2 * n + n_f, n_f, len(t)))
        for fading_s in np.unique(self.fading_s):
            own = np.flatnonzero(self.fading_s == fading_s)
            *answers, exponents = self._pushed(1.0 / fading_s)
            grown = np.exp(exponents[..., None] * t)
            for factors, rows in zip(answers, (slice(1, n), slice(n + 1, 2 * n)), strict=True):
                states[rows, own] = (factors[..., None] * grown).sum(axis=0).real[:, None] * self._basis[:, own, None]
        states[2 * n + np.arange(n_f), np.arange(n_f)] = np.exp(-t / self.fading_s[:, None])
        return states

    def _noises(self, dt: float, n_state: int) -> Floats:
        """Noise covariance from each of the first four `SOURCES` at unit variance, (4, n_state, n_state)."""
        n = 1 + self._roots.shape[1]
        noises = np.zeros((len(SOURCES) - 2, n_state, n_state))
        x, v = np.arange(1, n), n + np.arange(1, n)
        one, other = self._roots
        moved = np.stack([1.0, -1.0] / (one - other)[:, None], axis=1)  # response to an impulse
        rates = np.stack([one, other])
        grown = _grown(rates[:, None] + rates, dt) * self.span.white[1:] ** 2
        for a, rows in ((moved, x), (rates * moved, v)):
            for b, columns in ((moved, x), (rates * moved, v)):
                noises[0, rows, columns] = np.einsum("pi,qi,pqi->i", a, b, grown).real
        t, weights = _ages(dt, float(np.abs(self._roots).min(axis=0).max()))
        answers = self._driven(t) * np.sqrt(weights)
        for source in np.unique(self.driving):
            own = np.flatnonzero(self.driving == source)
            noise = self._noise[own][:, self._noise[own].any(axis=0)]
            columns = (answers[:, own].swapaxes(1, 2) @ noise).reshape(n_state, -1)
            noises[source] = columns @ columns.T
        return noises

    def _moved_by_constants(self, start: Floats, end: Floats, dt: float) -> Floats:
        """`Along.by_constants`, (2 n, any), for a motion over dt [s] from the state `start` to the state `end`."""
        n = 1 + self._roots.shape[1]
        if self._constants is None:
            return np.zeros((2 * n, 0))
        pushes = 0.5 * (self._constants @ (start[1:n] + end[1:n])).T
        return self.pushed(start, dt, np.vstack([np.zeros((1, pushes.shape[1])), pushes]))

    def pushed(self, _state: Floats, dt: float, accelerations: Floats) -> Floats:
        """Change of coordinates and velocities over dt [s], (2 n, k), due to constant accelerations [m/s²], (n, k)."""
        n = 1 + self._roots.shape[1]
        columns = np.zeros((2 * n, accelerations.shape[1]))
        *answers, rates = self._pushed(0.0)
        for factors, rows in zip(answers, (slice(1, n), slice(n + 1, 2 * n)), strict=True):
            columns[rows] = (factors * np.exp(rates * dt)).sum(axis=0).real[:, None] * accelerations[1:]
        return columns


def _effective(displacements: Floats) -> Floats:
    """Fewer combinations (n_fields, any) of force fields that cause nearly all displacements (n_full, n_fields)."""
    _, sizes, right = np.linalg.svd(displacements, full_matrices=False)
    kept = np.cumsum(sizes[::-1] ** 2)[::-1] > LEFT_OUT * (sizes**2).sum()
    return np.asarray(right[kept].T)


def _ages(dt: float, rate: float) -> tuple[Floats, Floats]:
    """Times and weights (k,) of a Gauss quadrature from 0 to dt [s]. The integrand's fastest rate is `rate` [1/s]."""
    edges = np.linspace(0.0, dt, 1 + max(1, int(np.ceil(rate * dt / PANEL))))
    x, weights = np.polynomial.legendre.leggauss(NODES)
    half = 0.5 * np.diff(edges)[:, None]
    return (edges[:-1, None] + half * (1.0 + x)).ravel(), (half * weights).ravel()


def _grown(rates: Exponents, dt: float) -> Exponents:
    """Integral of exp(rate t) from 0 to dt [s]."""
    apart = np.abs(rates) > APART**2
    safe = np.where(apart, rates, 1.0)
    return np.where(apart, np.expm1(safe * dt) / safe, dt)
