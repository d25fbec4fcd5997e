"""The motion of a continuum: damped modes under smooth surface forces that fade, in closed form.

A mode of rate w² and damping c follows x'' + c x' + w² x = f. Its answers to an impulse and to a force exp(-a t) are
sums of exponentials, so a step of any length is exact.
"""

from __future__ import annotations

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty
from dynamics.elements import Span
from estimators.arrays import Floats
from estimators.core.disturbances import Disturbances
from estimators.core.motion.model import SOURCES, Along

NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)
"""Of the quadrature over a step, on (-1, 1)."""

LONGEST_S = 1.0 / 60.0
"""Longest step of the quadrature [s]; numerical."""

APART = 1e-3
"""Least difference of the two roots of a mode, and least distance of a force's rate from them [1/s]; numerical."""

LEFT_OUT = 1e-6
"""Share of the mean square displacement by a source of forces that is left out, at most [1]; numerical."""

FIXED = 1e-6
"""Standard deviation of the coordinate that stands for the drawn shape, by itself [1]; numerical: it does not move."""


class ContinuumSpan(Span):
    """Places of the points of a continuum: those drawn, times a coordinate that never changes, and its modes."""

    @classmethod
    def of(cls, network: MassSpringNetwork) -> ContinuumSpan:
        """Of a network with a continuum; the first coordinate is always 1, the others are those of modes [m]."""
        solid = network.continuum
        assert solid is not None  # the caller's
        drawn = network.positions[network.free].reshape(-1, 1)
        masses = np.repeat(network.masses[network.free], network.dim)
        r = len(solid.rates)
        white = np.r_[0.0, np.full(r, np.sqrt(network.dim / r))]
        onto = np.vstack([np.zeros((1, len(drawn))), solid.shapes.T * masses / solid.mass])
        matrix = np.hstack([drawn, solid.shapes])
        return cls(matrix, onto, np.full(1 + r, solid.mass), white)

    def coordinates(self, places: Floats) -> Floats:
        """The coordinates (n,) next to places of all nodes [m], (n_full,)."""
        return np.r_[1.0, np.linalg.lstsq(self.matrix[:, 1:], places - self.matrix[:, 0], rcond=None)[0]]

    @property
    def independent(self) -> Floats:
        """Covariance of the coordinates (n, n) of displacements of unit variance, independent in each mode."""
        return np.diag(np.r_[FIXED**2, self.white[1:] ** 2])


class ContinuumMotion:
    """How a continuum moves, see `Motion`.

    Parameters
    ----------
    network : MassSpringNetwork
        With a continuum.
    disturbances : Disturbances
        Strengths are of surface forces that would accelerate the whole mass so.
    uncertainty : ParameterUncertainty, optional
        Of the stiffness of tissues.
    """

    def __init__(
        self, network: MassSpringNetwork, disturbances: Disturbances, uncertainty: ParameterUncertainty | None = None
    ) -> None:
        solid = network.continuum
        assert solid is not None  # the caller's
        self.is_linear = True
        self.extent_m, self.span = solid.extent_m, ContinuumSpan.of(network)
        held = solid.rates[solid.rates > 1e-6 * solid.rates.max()]
        self.raised = disturbances.raised(self.extent_m * float(held.min()))
        by_force = 1.0 / np.maximum(solid.rates, held.min())[:, None]  # displacement in the end
        pushes = {"short": _effective(solid.short, by_force), "slow": _effective(solid.slow, by_force)}
        self._basis = np.hstack(list(pushes.values()))
        counts = [push.shape[1] for push in pushes.values()]
        self.driving = np.repeat([SOURCES.index(name) for name in pushes], counts)
        self.fading_s = disturbances.fading_s(self.driving == SOURCES.index("slow"))
        root = np.sqrt((0.25 * solid.damping**2 - solid.rates).astype(complex))
        root = np.where(np.abs(root) < APART, APART, root)
        self._roots = np.stack([-0.5 * solid.damping + root, -0.5 * solid.damping - root])
        self._constants = None
        if uncertainty is not None:
            each = np.zeros((len(uncertainty.parameters), len(solid.rates), len(solid.rates)))
            for k, parameter in enumerate(uncertainty.parameters):
                each[k] = solid.by_tissue[parameter.index]
            self._constants = -np.tensordot(uncertainty.directions, each, 1)

    def moved(self, state: Floats, dt: float) -> Floats:
        """Coordinates, velocities and forces (2 n + n_f,) after dt [s] without noise."""
        motion, fading = self._motion(dt)
        return np.concatenate([motion @ state, fading * state[len(motion) :]])

    def along(self, state: Floats, dt: float) -> Along:
        """The motion from a state (2 n + n_f,) over dt [s]: it is linear."""
        motion, fading = self._motion(dt)
        mean = np.concatenate([motion @ state, fading * state[len(motion) :]])
        by_constants = self._moved_by_constants(state, mean, motion, dt)
        return Along(mean, motion, fading, self._noises(dt, len(state)), by_constants)

    def _impulse(self, t: Floats) -> tuple[Floats, Floats]:
        """Displacement [s] and velocity [1] of each mode at times t (k,) after a unit impulse, (n_modes, k) each."""
        one, other = self._roots[..., None]
        grown = np.exp(one * t), np.exp(other * t)
        return ((grown[0] - grown[1]) / (one - other)).real, ((one * grown[0] - other * grown[1]) / (one - other)).real

    def _pushed(self, t: Floats, rate: float) -> tuple[Floats, Floats]:
        """Displacement [s²] and velocity [s] of each mode at times t (k,) under exp(-rate t), (n_modes, k) each."""
        one, other = self._roots[..., None]
        a = np.where(np.minimum(np.abs(one + rate), np.abs(other + rate)) < APART, rate + 2.0 * APART, rate)
        fading, x, v = np.exp(-a * t), 0.0, 0.0
        for root, sign in ((one, 1.0), (other, -1.0)):
            share = sign / ((one - other) * (root + a))
            x = x + share * (np.exp(root * t) - fading)
            v = v + share * (root * np.exp(root * t) + a * fading)
        return np.asarray(x).real, np.asarray(v).real

    def _motion(self, dt: float) -> tuple[Floats, Floats]:
        """Derivative of coordinates and velocities by the state before, (2 n, 2 n + n_f), and fading of forces."""
        r, end = self._roots.shape[1], np.array([dt])
        n, x = 1 + r, np.arange(1, 1 + r)
        by_x, by_v = self._impulse(end)
        damping, rates = -self._roots.sum(axis=0).real, self._roots.prod(axis=0).real
        motion = np.zeros((2 * n, 2 * n + len(self.driving)))
        motion[0, 0] = 1.0
        motion[n, n] = 1.0
        motion[x, x], motion[x, n + x] = by_v[:, 0] + damping * by_x[:, 0], by_x[:, 0]
        motion[n + x, x], motion[n + x, n + x] = -rates * by_x[:, 0], by_v[:, 0]
        for own, rate in self._kinds():
            moved, speed = self._pushed(end, rate)
            motion[1:n, 2 * n + own] = moved * self._basis[:, own]
            motion[n + 1 : 2 * n, 2 * n + own] = speed * self._basis[:, own]
        return motion, np.exp(-dt / self.fading_s)

    def _kinds(self) -> list[tuple[np.ndarray, float]]:
        """States of the forces of each source, and the rate at which they fade [1/s]."""
        kinds = [np.flatnonzero(self.driving == source) for source in np.unique(self.driving)]
        return [(own, 1.0 / float(self.fading_s[own[0]])) for own in kinds]

    def _noises(self, dt: float, n_state: int) -> Floats:
        """Of `SOURCES` but the last two at unit variance, (4, n_state, n_state): answers to noise of every age."""
        n = 1 + self._roots.shape[1]
        steps = max(1, int(np.ceil(dt / LONGEST_S)))
        h = dt / steps
        ages = (h * (np.arange(steps)[:, None] + 0.5 * (1.0 + NODES))).ravel()
        weights = np.tile(0.5 * h * WEIGHTS, steps)
        noises = np.zeros((len(SOURCES) - 2, n_state, n_state))
        x, v, white = np.arange(1, n), n + np.arange(1, n), self.span.white[1:] ** 2
        moved, speed = self._impulse(ages)
        for rows, columns, cov in ((x, x, moved**2), (x, v, moved * speed), (v, x, moved * speed), (v, v, speed**2)):
            noises[0, rows, columns] = white * (cov @ weights)
        for own, rate in self._kinds():
            noise, basis, faded = noises[self.driving[own[0]]], self._basis[:, own], np.exp(-rate * ages)
            answers, square = self._pushed(ages, rate), basis @ basis.T
            force, weighing = 2 * n + own, 2.0 * rate * weights
            for a, rows in zip(answers, (slice(1, n), slice(n + 1, 2 * n)), strict=True):
                for b, columns in zip(answers, (slice(1, n), slice(n + 1, 2 * n)), strict=True):
                    noise[rows, columns] = (a * weighing) @ b.T * square
                noise[rows, force] = ((a * weighing) @ faded)[:, None] * basis
                noise[force, rows] = noise[rows, force].T
            noise[force, force] = -np.expm1(-2.0 * rate * dt)
        return noises

    def _moved_by_constants(self, start: Floats, end: Floats, motion: Floats, dt: float) -> Floats:
        """Effect of each constant that is off by one standard deviation, (2 n, n_constants), by the trapezium rule."""
        n = len(motion) // 2
        columns = np.zeros((2 * n, 0 if self._constants is None else len(self._constants)))
        if self._constants is None:
            return columns
        columns[n + 1 :] = 0.5 * dt * (self._constants @ start[1:n]).T
        columns = motion[:, : 2 * n] @ columns
        columns[n + 1 :] += 0.5 * dt * (self._constants @ end[1:n]).T
        return columns


def _effective(push: Floats, by_force: Floats) -> Floats:
    """Columns (n_modes, any) of accelerations, in as few as displace the body alike but for a share `LEFT_OUT`.

    by_force: displacement of each mode by its acceleration [s²], (n_modes, 1)
    """
    _, sizes, right = np.linalg.svd(by_force * push, full_matrices=False)
    kept = np.cumsum(sizes[::-1] ** 2)[::-1] > LEFT_OUT * (sizes**2).sum()
    return np.asarray(push @ right[kept].T)
