"""Implicit steps for stiff or large networks, with their transition matrices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynamics.arrays import Floats
from dynamics.forces.kernels import TR_BDF2, implicit_steps, packed, tangents_each
from dynamics.integration.stepping import LONGEST_STEP, SAME_STEP
from dynamics.network.mass_spring import MassSpringNetwork

FEW = 48
"""Up to this number of coordinates, each Newton iteration computes new tangents, as springs of 2e7 N/m require. With
more coordinates, all iterations use the tangents at the step's start, which is enough for springs of up to 2e5 N/m."""

ROUNDING = 1e-9
"""Share of a matrix's largest entry below which a stiffness is only a rounding error."""

DRIVEN = 1e12
"""Factor by which the mass of a driven node is multiplied, so that forces do not change its velocity [1]; numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """Derivatives of the state after an interval, for k states.

    F: derivative with respect to the state at the start of the interval, (k, n_state, n_state)
    by_force: derivative with respect to constant forces on the coordinates [m/N, m/(s N)], (k, n_state, n_state / 2)
    half: the same derivative as F, for half the interval; equal to F if the interval is a single step
    """

    F: Floats
    by_force: Floats
    half: Floats


class ImplicitStepper:
    """Implicit integrator for states of one network: compiled TR-BDF2 steps of at most LONGEST_STEP.

    The steps are L-stable [bank1985]: stiffness does not limit their length. Motions faster than a step are damped.
    """

    def __init__(self, network: MassSpringNetwork) -> None:
        self.network = network
        self._packed = packed(network)
        self._masses = np.repeat(network.masses[network.free], network.dim)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return type(self), (self.network,)

    def n_steps(self, dt: float) -> int:
        """Number of equal steps for an interval of dt [s]: a power of two, so that `linearised` can square matrices."""
        return 1 << max(0, int(np.ceil(np.log2(max(dt / LONGEST_STEP * (1.0 - SAME_STEP), 1.0)))))

    def advance(self, states: Floats, dt: float, forces: Floats | None = None, *, driven: Sequence[int] = ()) -> Floats:
        """States (n_points, n_state) after dt [s]; driven: free nodes that keep their velocity under any force.

        forces: constant forces on the free coordinates [N], (n_points, n_state / 2)
        """
        n, nodes = self.n_steps(dt), self.network.positions
        points = np.ascontiguousarray(states)
        outside = np.zeros((len(points), len(self._masses))) if forces is None else np.ascontiguousarray(forces)
        renew, free, masses = len(self._masses) <= FEW, self.network.free, self._masses_with(driven)
        return implicit_steps(points, outside, dt / n, n, renew, nodes, free, masses, self._packed)

    def _masses_with(self, driven: Sequence[int]) -> Floats:
        """Masses of the free coordinates [kg], (n_state / 2,). Masses of driven nodes are multiplied by `DRIVEN`."""
        if not len(driven):
            return self._masses
        return self._masses * np.repeat(np.where(np.isin(self.network.free, driven), DRIVEN, 1.0), self.network.dim)

    def linearised(self, states: Floats, dt: float, *, driven: Sequence[int] = ()) -> Linearised:
        """Derivatives of `advance` over dt [s] in given states, (n_points, n_state).

        driven: free nodes that keep their velocity under any force

        Buckling tissue has an indefinite stiffness. In such a state, the negative stiffness across compressed springs
        is replaced by 0. Otherwise the linear motion would grow without limit.
        """
        n = self.n_steps(dt)
        h, masses = dt / n, self._masses_with(driven)
        K, C = self._tangents(np.ascontiguousarray(states))
        half, by_mass = K.shape[1], 1.0 / masses
        # W = 1 / (1 - w A), as in each stage, for A = h (0, 1; -K / M, -C / M); only its lower half is computed
        w, each = 0.5 * TR_BDF2, masses[:, None]
        inverse = np.linalg.inv(np.eye(half) * each + w * h * C + (w * h) ** 2 * K)
        lower = np.concatenate([-w * h * inverse @ K, inverse * masses], axis=2)
        W = np.concatenate([w * h * lower, lower], axis=1)
        W[:, :half, :half] += np.eye(half)
        second, first = 1.0 / (TR_BDF2 * (2.0 - TR_BDF2)), (1.0 - TR_BDF2) ** 2 / (TR_BDF2 * (2.0 - TR_BDF2))
        # A W = (W - 1) / w
        F = _times(lower, w * h, (2.0 * second) * W - second * np.eye(2 * half))
        F -= first * W
        pushed = W[:, :, half:] * (h * by_mass)
        by_force = second * TR_BDF2 * _times(lower, w * h, pushed) + w * pushed
        before = F
        for _ in range(n.bit_length() - 1):
            before = F
            by_force = F @ by_force + by_force
            F = F @ F
        return Linearised(F, by_force, before)

    def _tangents(self, states: Floats) -> tuple[Floats, Floats]:
        """Stiffness and damping in each state, (k, n_half, n_half). Indefinite matrices are made semidefinite."""
        own = self.network.positions, self.network.free, self._packed
        K, C = tangents_each(states, False, *own)
        if _are_semidefinite(K):
            return K, C
        for k in range(len(states)):
            if not _are_semidefinite(K[k]):
                clipped, C_clipped = tangents_each(states[k : k + 1], True, *own)
                K[k], C[k] = clipped[0], C_clipped[0]
        return K, C


def _times(lower: Floats, step: float, right: Floats) -> Floats:
    """Product of W and `right`, (k, 2 n, m). Rows of W: first `(1, 0) + step lower`, then `lower`, (k, n, 2 n)."""
    n = lower.shape[1]
    below = lower @ right
    return np.concatenate([right[:, :n] + step * below, below], axis=1)


def _are_semidefinite(K: Floats) -> bool:
    """Whether all stiffness matrices (..., n, n) are positive semidefinite up to rounding."""
    largest = np.abs(K).max(axis=(-2, -1), keepdims=True)
    try:
        np.linalg.cholesky(K + ROUNDING * largest * np.eye(K.shape[-1]))
    except np.linalg.LinAlgError:
        return False
    return True
