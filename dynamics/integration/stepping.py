"""Motion in time: fixed Runge-Kutta steps for filters, SciPy's adaptive steps for reference and for the paper."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import DOP853, RK45, Radau

from dynamics.arrays import Floats
from dynamics.forces.kernels import packed, runge_kutta, state_rate
from dynamics.forces.tangent import stable_step
from dynamics.network.mass_spring import MassSpringNetwork

LONGEST_STEP = 1.0 / 240.0
"""Longest Runge-Kutta step [s]; numerical: after half a second at 0.5 m/s, the error is below 0.01 mm, as
`tests/dynamics/integration/test_stepping.py` checks."""

SOLVERS = {"RK45": RK45, "DOP853": DOP853, "Radau": Radau}

SAME_STEP = 1e-6
"""Relative excess of an interval over n steps, up to which n steps suffice [1]. Times are often rounded to 1 ns."""


class Stepper:
    """Integrator for batches of states of one network: compiled classical Runge-Kutta steps.

    max_step_s: longest step [s]; in a network of springs, at most half the longest stable step, see `stable_step`
    """

    def __init__(self, network: MassSpringNetwork, longest_s: float = LONGEST_STEP) -> None:
        self.network = network
        self.max_step_s = longest_s
        if network.continuum is None:
            self.max_step_s = min(longest_s, 0.5 * stable_step(network))
        self._packed = packed(network)
        inverse_mass = np.zeros(network.n_nodes)
        inverse_mass[network.free] = 1.0 / network.masses[network.free]
        self._inverse_mass = inverse_mass
        self._n_state = network.n_state

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return type(self), (self.network, self.max_step_s)

    def n_steps(self, dt: float) -> int:
        """Number of equal steps for an interval of dt seconds."""
        return max(1, int(np.ceil(dt / self.max_step_s * (1.0 - SAME_STEP))))

    def advance(self, states: Floats, dt: float, forces: Floats | None = None, *, driven: Sequence[int] = ()) -> Floats:
        """States after dt seconds, (n_points, n_state), under constant outside forces.

        states: (n_points, n_state); forces: on the free coordinates [N], (n_points, n_state / 2); None: no forces
        driven: free nodes that keep their velocity under any force
        Raises ValueError for other shapes or a negative dt.
        """
        n_points, n_state = len(states), self._n_state
        outside = np.zeros((n_points, n_state // 2)) if forces is None else forces
        if states.shape != (n_points, n_state) or outside.shape != (n_points, n_state // 2):
            raise ValueError(
                f"expected states (n, {n_state}) and forces (n, {n_state // 2}), "
                f"found {states.shape} and {outside.shape}"
            )
        if not dt >= 0:
            raise ValueError(f"dt: expected 0 s or more, found {dt}")
        n = self.n_steps(dt)
        if self.network.continuum is not None:
            return self._trapezoidal(states, outside, dt / n, n, driven)
        inverse_mass = self._inverse_mass
        if len(driven):
            inverse_mass = inverse_mass.copy()
            inverse_mass[np.asarray(driven)] = 0.0
        return runge_kutta(
            np.ascontiguousarray(states),
            np.ascontiguousarray(outside),
            dt / n,
            n,
            self.network.positions,
            self.network.free,
            inverse_mass,
            self._packed,
        )

    def _trapezoidal(self, states: Floats, outside: Floats, h: float, n: int, driven: Sequence[int]) -> Floats:
        """Take n trapezoidal steps of h [s]. They are stable for any h, because the motion of a continuum is linear."""
        network, solid = self.network, self.network.continuum
        assert solid is not None
        half = self._n_state // 2
        moves = np.repeat(~np.isin(network.free, driven), network.dim)
        masses = np.repeat(network.masses[network.free], network.dim)
        K, C = solid.stiffness, solid.dashpots + np.diag(np.repeat(network.drag[network.free], network.dim))
        left = np.diag(masses) + 0.5 * h * C + 0.25 * h**2 * K
        solve = np.zeros((half, half))
        solve[np.ix_(moves, moves)] = np.linalg.inv(left[np.ix_(moves, moves)])
        x, v = states[:, :half] - network.positions[network.free].ravel(), states[:, half:].copy()
        for _ in range(n):
            # change of velocity w: M w = h (F - K (x + h/2 v + h/4 w) - C (v + w/2)), zero for driven nodes
            force = outside - (x + 0.5 * h * v) @ K - v @ C
            w = h * force @ solve
            x += h * (v + 0.5 * w)
            v += w
        return np.concatenate([x + network.positions[network.free].ravel(), v], axis=1)


def derivative(network: MassSpringNetwork, state: Floats, force: ArrayLike = 0.0) -> Floats:
    """Time derivative of a state, (n_state,), under an outside force on the free nodes [N], (n_free, dim)."""
    return motion(network)(state, force)


def motion(network: MassSpringNetwork) -> Callable[[Floats, ArrayLike], Floats]:
    """Function from states (..., n_state) [m, m/s] and outside forces [N] to the time derivative of the states.

    The function reuses its arrays, because an adaptive integrator calls it 10,000 times.
    """
    x = network.positions[:, :, None].copy()
    v, force = np.zeros_like(x), np.empty_like(x)
    shape = (len(network.free), network.dim)
    kept = (network.free, 1.0 / network.masses[network.free], x, v, force, *packed(network))
    solid, drawn, half = network.continuum, network.positions[network.free].ravel(), network.n_state // 2

    def rate(state: Floats, outside: ArrayLike = 0.0) -> Floats:
        acting = np.ascontiguousarray(outside, dtype=float)
        if acting.shape != shape:
            acting = np.broadcast_to(acting, shape).copy()
        if solid is not None:
            pull = (state[..., :half] - drawn) @ solid.stiffness + state[..., half:] @ solid.dashpots
            acting = acting - pull.reshape(shape)
        return np.asarray(state_rate(np.ascontiguousarray(state, dtype=float), acting, *kept))

    return rate


def integrate_adaptive(
    network: MassSpringNetwork,
    state: Floats,
    times: ArrayLike,
    *,
    force: Callable[[float], ArrayLike] = lambda _t: 0.0,
    method: Literal["RK45", "DOP853", "Radau"] = "DOP853",
    rtol: float = 1e-9,
    atol: float = 1e-12,
    max_step_s: float = np.inf,
    bends_s: ArrayLike = (),
) -> Floats:
    """States at the times [s], (n_times, n_state), by SciPy's adaptive Runge-Kutta from `state` at the first time.

    method: an explicit method or, for stiff networks, the implicit method "Radau"
    force(t): outside force on the free nodes [N], (n_free, dim). If the force is brief or jumps, max_step_s must be so
        small that no step misses the change.
    bends_s: times at which the slope of the force jumps [s]; a step ends at each of these times
    Raises RuntimeError if the integrator fails.
    """
    t = np.asarray(times, dtype=float)
    bends = np.unique(np.asarray(bends_s, dtype=float))
    between = bends[(bends > t[0]) & (bends < t[-1])]
    rate, now, step = motion(network), np.asarray(state, dtype=float), None
    states, n_done = np.empty((len(t), len(now))), 0
    for begin, end in pairwise([t[0], *between, t[-1]]):
        solver = SOLVERS[method](
            lambda at, s: rate(s, force(at)),
            begin,
            now,
            end,
            max_step=max_step_s,
            rtol=rtol,
            atol=atol,
            first_step=None if step is None else min(step, end - begin),
        )
        while solver.status == "running":
            message = solver.step()
            if solver.status == "failed":
                raise RuntimeError(f"integration from {t[0]:.6g} to {t[-1]:.6g} s: {message}")
            n_reached = int(np.searchsorted(t, solver.t, side="right"))
            if n_reached > n_done:
                states[n_done:n_reached] = solver.dense_output()(t[n_done:n_reached]).T
                n_done = n_reached
        now, step = solver.y, solver.h_abs
    return states
