"""Force laws as scalar functions, and compiled loops over springs, nodes and time steps.

A force law consists of functions of one spring or one node: the force, its potential and its derivatives. The compiled
loops call these functions with numbers, and all other code calls them with arrays. `tests/dynamics/forces/test_laws.py`
checks every law of LAWS against finite differences.

    tension of a spring     T = k (l - l0) + c dl/dt [N]
    resistance of a node    R = drag + friction / sqrt(v.v + slip²) [N s/m], with the force -R v

Laws and loops share this file because numba's disk cache notices only changes to a kernel's own file. Arrays in the
loops have the shape (n_nodes, dim, n_points), so that the innermost loop runs over the states, which are adjacent in
memory. The loops copy number by number, because slice assignments take seconds longer to compile.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable

from dynamics.arrays import Floats
from dynamics.network.mass_spring import MassSpringNetwork

Numbers = float | Floats

SLIP_VELOCITY = 5e-3
"""Speed at which friction reaches 71 % of its full value [m/s]; numerical: true friction jumps at speed 0, where a
derivative is needed. Half or twice this speed changes motion by less than 1 %: `tests/dynamics/forces/test_laws.py`."""

SHORTEST = 1e-9
"""Length below which a spring has no direction and exerts no force [m]."""

FASTMATH = {"contract", "reassoc", "nsz", "arcp"}
"""Reorderings that the compiler may apply in the loops over a batch; NaN and infinity keep their meaning."""


class SpringConstants(NamedTuple):
    """Stiffness [N/m], rest length [m] and damping [N s/m] of one spring, or of all springs, (n_springs,) each."""

    stiffness: Floats
    rest_length: Floats
    damping: Floats


class NodeConstants(NamedTuple):
    """Drag [N s/m] and Coulomb friction [N] of one node, or of all nodes, (n_nodes,) each."""

    drag: Floats
    friction: Floats


LAWS: Mapping[str, tuple[str, ...]] = {
    "spring": ("stiffness", "rest_length"),
    "dashpot": ("damping",),
    "drag": ("drag",),
    "friction": ("friction",),
}
"""Kinds of constants of each force law: first the laws of springs, then the laws of nodes."""

KINDS = tuple(kind for kinds in LAWS.values() for kind in kinds)
"""All kinds of constants, in the order of the fields of `SpringConstants`, then of `NodeConstants`."""

OF_SPRINGS = SpringConstants._fields
"""Kinds of constants that belong to a spring. All other kinds belong to a node."""

N_OF_SPRINGS = len(OF_SPRINGS)

FIELDS = {kind: kind for kind in KINDS} | {"rest_length": "rest_lengths"}
"""Field of `MassSpringNetwork` for each kind of constant."""


# Force laws of a spring, as functions of its length [m] and its rate [m/s]; c: its SpringConstants.


@register_jitable(fastmath=FASTMATH)
def spring_tension(length: Numbers, rate: Numbers, c: SpringConstants) -> Floats:
    """Tension of a spring [N], positive where it pulls its nodes together; rate: derivative of the length [m/s]."""
    return c.stiffness * (length - c.rest_length) + c.damping * rate


def spring_potential(length: Numbers, c: SpringConstants) -> Floats:
    """Stored energy [J]. Its derivative with respect to the length is the tension without the dashpot's part."""
    return 0.5 * c.stiffness * (length - c.rest_length) ** 2


@register_jitable
def tension_by_length(length: Numbers, rate: Numbers, c: SpringConstants) -> Floats:
    """Derivative of the tension with respect to the length [N/m]."""
    return c.stiffness


@register_jitable
def tension_by_rate(length: Numbers, rate: Numbers, c: SpringConstants) -> Floats:
    """Derivative of the tension with respect to the rate [N s/m]."""
    return c.damping


@register_jitable
def tension_by_log_constants(length: Numbers, rate: Numbers, c: SpringConstants) -> SpringConstants:
    """Derivatives of the tension with respect to the logarithm of each constant [N]."""
    return SpringConstants(
        stiffness=c.stiffness * (length - c.rest_length),
        rest_length=-c.stiffness * c.rest_length,
        damping=c.damping * rate,
    )


# Force laws of a node, as functions of its squared speed [m²/s²]; c: its NodeConstants.


@register_jitable(fastmath=FASTMATH)
def node_resistance(square: Numbers, c: NodeConstants) -> Floats:
    """Resistance R of a node [N s/m]; at the velocity v, the force is -R v. square: squared speed [m²/s²]."""
    return c.drag + c.friction / np.sqrt(square + SLIP_VELOCITY * SLIP_VELOCITY)


@register_jitable
def resistance_by_square(square: Numbers, c: NodeConstants) -> Floats:
    """Derivative of the resistance with respect to the squared speed [N s³/m³]."""
    return -0.5 * c.friction / (square + SLIP_VELOCITY * SLIP_VELOCITY) ** 1.5


@register_jitable
def resistance_by_log_constants(square: Numbers, c: NodeConstants) -> NodeConstants:
    """Derivative of the resistance with respect to the log of each constant [N s/m]."""
    return NodeConstants(
        drag=c.drag,
        friction=c.friction / np.sqrt(square + SLIP_VELOCITY * SLIP_VELOCITY),
    )


# Force laws along a needle, as functions of its speed relative to the adjacent tissue [m/s].


@register_jitable
def contact_force(dent: Numbers, stiffness: float) -> Numbers:
    """Force of the tip on the skin before the puncture [N]; dent: depth of the dent [m], negative before contact."""
    return stiffness * np.maximum(0.0, dent)


@register_jitable
def sliding_force(slide: Numbers, most: Numbers, slip: float) -> Numbers:
    """Cutting or friction force [N]. It tends to `most` if the needle slides much faster than the slip velocity."""
    return most * slide / np.sqrt(slide * slide + slip * slip)


class Packed(NamedTuple):
    """Arrays of a network in the form that the kernels need.

    springs: the two nodes of each spring, (n_springs, 2); weight: weight of each node [N], (n_nodes, dim), 0 for
        anchors
    spring_constants: (n_springs, n_constants), columns as in `SpringConstants`
    node_constants: (n_nodes, n_constants), columns as in `NodeConstants`
    """

    springs: np.ndarray
    spring_constants: Floats
    node_constants: Floats
    weight: Floats


@lru_cache(maxsize=64)
def packed(network: MassSpringNetwork) -> Packed:
    """Arrays of a network in the form that the kernels need."""
    weight = np.where(network.fixed[:, None], 0.0, network.masses[:, None] * network.gravity)
    of_springs = [getattr(network, FIELDS[kind]) for kind in SpringConstants._fields]
    of_nodes = [getattr(network, FIELDS[kind]) for kind in NodeConstants._fields]
    return Packed(network.springs, np.stack(of_springs, axis=1), np.stack(of_nodes, axis=1), weight)


@lru_cache(maxsize=64)
def spring_constants(network: MassSpringNetwork) -> SpringConstants:
    """Constants of all springs, (n_springs,) each, in the form that the force laws need."""
    return SpringConstants(*packed(network).spring_constants.T)


@lru_cache(maxsize=64)
def node_constants(network: MassSpringNetwork) -> NodeConstants:
    """Constants of all nodes, (n_nodes,) each, in the form that the force laws need."""
    return NodeConstants(*packed(network).node_constants.T)


@register_jitable
def _of_spring(p, s):  # type: ignore[no-untyped-def]
    """Constants of one spring, as numbers."""
    row = p.spring_constants[s]
    return SpringConstants(row[0], row[1], row[2])


@register_jitable
def _of_node(p, i):  # type: ignore[no-untyped-def]
    """Constants of one node, as numbers."""
    row = p.node_constants[i]
    return NodeConstants(row[0], row[1])


@njit(cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def spring_forces(x, v, p, pull, square, force):  # type: ignore[no-untyped-def]
    """Write the force on each node [N] into `force`, (n_nodes, dim, n_points); pull, square: scratch, (n_points,)."""
    n_nodes, dim, n_points = x.shape
    for i in range(n_nodes):
        node = _of_node(p, i)
        for q in range(n_points):
            square[q] = v[i, 0, q] * v[i, 0, q]
        for d in range(1, dim):
            for q in range(n_points):
                square[q] += v[i, d, q] * v[i, d, q]
        for q in range(n_points):
            pull[q] = node_resistance(square[q], node)
        for d in range(dim):
            for q in range(n_points):
                force[i, d, q] = p.weight[i, d] - pull[q] * v[i, d, q]
    for s in range(p.springs.shape[0]):
        i, j = p.springs[s, 0], p.springs[s, 1]
        spring = _of_spring(p, s)
        for q in range(n_points):
            apart = x[j, 0, q] - x[i, 0, q]
            square[q] = apart * apart + SHORTEST * SHORTEST
            pull[q] = apart * (v[j, 0, q] - v[i, 0, q])
        for d in range(1, dim):
            for q in range(n_points):
                apart = x[j, d, q] - x[i, d, q]
                square[q] += apart * apart
                pull[q] += apart * (v[j, d, q] - v[i, d, q])
        for q in range(n_points):
            inverse = 1.0 / np.sqrt(square[q])
            pull[q] = spring_tension(square[q] * inverse, pull[q] * inverse, spring) * inverse
        for d in range(dim):
            for q in range(n_points):
                f = pull[q] * (x[j, d, q] - x[i, d, q])
                force[i, d, q] += f
                force[j, d, q] -= f


@njit(cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def state_rate(  # type: ignore[no-untyped-def]
    state, outside, free, inverse_mass, x, v, force, springs, of_springs, of_nodes, weight
):
    """Time derivative of a state, (n_state,), under forces on the free nodes [N], (n_free, dim).

    x: positions of all nodes, (n_nodes, dim, 1); the positions of free nodes are overwritten
    v, force: scratch arrays of the same shape, with v zero at anchors; inverse_mass: (n_free,)
    The fields of `Packed` are separate arguments, because passing a tuple takes longer than computing all forces.
    """
    n_free, dim = outside.shape
    half = n_free * dim
    rate = np.empty(2 * half)
    for r in range(half):
        i, d = free[r // dim], r % dim
        x[i, d, 0] = state[r]
        v[i, d, 0] = rate[r] = state[half + r]
    p = Packed(springs, of_springs, of_nodes, weight)
    spring_forces(x, v, p, np.empty(1), np.empty(1), force)
    for r in range(half):
        k, d = r // dim, r % dim
        rate[half + r] = (force[free[k], d, 0] + outside[k, d]) * inverse_mass[k]
    return rate


@njit(cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def runge_kutta(states, outside, dt, n_steps, nodes, free, inverse_mass, p):  # type: ignore[no-untyped-def]
    """States after n_steps classical Runge-Kutta steps of dt, (n_points, n_state).

    outside: constant force on each free coordinate [N], (n_points, n_free dim)
    nodes: positions of all nodes [m], (n_nodes, dim), of which only the anchors are used
    """
    n_points = states.shape[0]
    n_nodes, dim = nodes.shape
    n_half = free.shape[0] * dim
    x = np.empty((n_nodes, dim, n_points))
    v = np.zeros((n_nodes, dim, n_points))
    force = np.empty((n_nodes, dim, n_points))
    pull, square = np.empty(n_points), np.empty(n_points)
    start = np.empty((2 * n_half, n_points))
    total = np.empty((2 * n_half, n_points))
    for i in range(n_nodes):
        for d in range(dim):
            for q in range(n_points):
                x[i, d, q] = nodes[i, d]
    for r in range(2 * n_half):
        for q in range(n_points):
            start[r, q] = states[q, r]
    for _ in range(n_steps):
        for r in range(n_half):
            i, d = free[r // dim], r % dim
            for q in range(n_points):
                x[i, d, q] = start[r, q]
                v[i, d, q] = start[n_half + r, q]
                total[r, q] = 0.0
                total[n_half + r, q] = 0.0
        for stage in range(4):
            spring_forces(x, v, p, pull, square, force)
            share = dt / 6.0 if stage in (0, 3) else dt / 3.0
            ahead = dt if stage == 2 else dt / 2.0
            for r in range(n_half):
                i, d = free[r // dim], r % dim
                by = inverse_mass[i]
                for q in range(n_points):
                    velocity = v[i, d, q]
                    acceleration = (force[i, d, q] + outside[q, r]) * by
                    total[r, q] += share * velocity
                    total[n_half + r, q] += share * acceleration
                    x[i, d, q] = start[r, q] + ahead * velocity
                    v[i, d, q] = start[n_half + r, q] + ahead * acceleration
        for r in range(2 * n_half):
            for q in range(n_points):
                start[r, q] += total[r, q]
    return np.ascontiguousarray(start.T)


@register_jitable
def _add_pair(matrix, i, j, a, b, entry):  # type: ignore[no-untyped-def]
    """Add entry (a, b) of a spring's matrix to `matrix`; i, j: first coordinate of each end, -1 for an anchor."""
    if i >= 0:
        matrix[i + a, i + b] += entry
    if j >= 0:
        matrix[j + a, j + b] += entry
    if i >= 0 and j >= 0:
        matrix[i + a, j + b] -= entry
        matrix[j + a, i + b] -= entry


@njit(cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def tangents(x, v, p, place, definite, K, C):  # type: ignore[no-untyped-def]
    """Write stiffness K [N/m] and damping C [N s/m] of the free coordinates into arrays (n_half, n_half).

    x, v: (n_nodes, dim, 1); place: index of each node's first coordinate among all free coordinates, -1 for an anchor
    definite: whether negative coefficients of springs, such as `T / l` across a compressed spring, are set to 0. K
        and C are then semidefinite, and an implicit step damps buckling
    """
    n_nodes, dim, _ = x.shape
    K[:], C[:] = 0.0, 0.0
    n, square = np.empty(dim), 0.0
    for i in range(n_nodes):
        if place[i] < 0:
            continue
        square = 0.0
        for d in range(dim):
            square += v[i, d, 0] * v[i, d, 0]
        resistance = node_resistance(square, _of_node(p, i))
        for d in range(dim):
            C[place[i] + d, place[i] + d] += resistance
    for s in range(p.springs.shape[0]):
        i, j = p.springs[s, 0], p.springs[s, 1]
        spring = _of_spring(p, s)
        square, rate = SHORTEST * SHORTEST, 0.0
        for d in range(dim):
            n[d] = x[j, d, 0] - x[i, d, 0]
            square += n[d] * n[d]
            rate += n[d] * (v[j, d, 0] - v[i, d, 0])
        length = np.sqrt(square)
        rate /= length
        across = spring_tension(length, 0.0, spring) / length
        along = tension_by_length(length, rate, spring)
        damping = tension_by_rate(length, rate, spring)
        if definite:
            across, along, damping = np.maximum(across, 0.0), np.maximum(along, 0.0), np.maximum(damping, 0.0)
        along -= across
        for a in range(dim):
            for b in range(dim):
                shared = n[a] * n[b] / square
                k, c = along * shared, damping * shared
                if a == b:
                    k += across
                _add_pair(K, place[i], place[j], a, b, k)
                _add_pair(C, place[i], place[j], a, b, c)


@njit(cache=True, nogil=True, error_model="numpy")
def linearised(q, v, nodes, place, springs, of_springs, of_nodes, weight, with_slopes):  # type: ignore[no-untyped-def]
    """Force on the free coordinates [N], (n,), and minus its derivatives by q [N/m] and v [N s/m], (n, n) each.

    q, v: free coordinates and rates, (n,) each; nodes, place: as in `runge_kutta` and `tangents`
    springs, of_springs, of_nodes, weight: the fields of `Packed`; with_slopes: whether to compute derivatives
    Unlike `tangents`, the derivatives are exact: they include rotations of dashpots and the derivative of friction.
    """
    n_nodes, dim = nodes.shape
    p = Packed(springs, of_springs, of_nodes, weight)
    x, u = nodes.copy(), np.zeros((n_nodes, dim))
    size = len(q) if with_slopes else 0
    force, K, C = np.zeros(len(q)), np.zeros((size, size)), np.zeros((size, size))
    for i in range(n_nodes):
        if place[i] < 0:
            continue
        node, square = _of_node(p, i), 0.0
        for d in range(dim):
            x[i, d], u[i, d] = q[place[i] + d], v[place[i] + d]
            square += u[i, d] * u[i, d]
        resistance = node_resistance(square, node)
        for a in range(dim):
            force[place[i] + a] = weight[i, a] - resistance * u[i, a]
            if with_slopes:
                C[place[i] + a, place[i] + a] += resistance
                for b in range(dim):
                    C[place[i] + a, place[i] + b] += 2.0 * resistance_by_square(square, node) * u[i, a] * u[i, b]
    along, turning = np.empty(dim), np.empty(dim)
    for s in range(springs.shape[0]):
        i, j = springs[s, 0], springs[s, 1]
        spring, square, rate = _of_spring(p, s), SHORTEST * SHORTEST, 0.0
        for d in range(dim):
            along[d], turning[d] = x[j, d] - x[i, d], u[j, d] - u[i, d]
            square += along[d] * along[d]
        length = np.sqrt(square)
        for d in range(dim):
            along[d] /= length
            rate += turning[d] * along[d]
        tension = spring_tension(length, rate, spring)
        for d in range(dim):
            turning[d] -= rate * along[d]
            if place[i] >= 0:
                force[place[i] + d] += tension * along[d]
            if place[j] >= 0:
                force[place[j] + d] -= tension * along[d]
        if not with_slopes:
            continue
        across = tension / length
        stretching, damping = tension_by_length(length, rate, spring), tension_by_rate(length, rate, spring)
        for a in range(dim):
            for b in range(dim):
                k = ((stretching - across) * along[b] + damping / length * turning[b]) * along[a]
                if a == b:
                    k += across
                _add_pair(K, place[i], place[j], a, b, k)
                _add_pair(C, place[i], place[j], a, b, damping * along[a] * along[b])
    return force, K, C


TR_BDF2 = 2.0 - np.sqrt(2.0)
"""Length of the first stage (trapezoidal rule) divided by the step. Both stages then share one matrix [bank1985]."""

NEWTON, MOST_NEWTON = 2, 8
"""Least and largest number of Newton iterations in a stage; numerical: a spring of 2e7 N/m oscillates equally with two
and with four iterations. After the least number, the iterations end as soon as one contracts, see `CONTRACTED`."""

CONTRACTED = 0.5
"""An iteration contracts if it changes the speeds by at most this share of the previous change, see `_newton`."""

STILL = 1e-12
"""The iteration of a stage ends if positions change by at most this share [1]: smaller changes are rounding errors."""


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _solve_triangles(L, right):  # type: ignore[no-untyped-def]
    """Overwrite `right`, (n,), with `(L L')^-1 right`; L, (n, n), is lower triangular."""
    n = len(right)
    for i in range(n):
        entry = 0.0
        for k in range(i):
            entry += L[i, k] * right[k]
        right[i] = (right[i] - entry) / L[i, i]
    for i in range(n - 1, -1, -1):
        entry = right[i] / L[i, i]
        right[i] = entry
        for k in range(i):
            right[k] -= L[i, k] * entry


@njit(cache=True, nogil=True)
def _factorise(x, v, p, place, weight, masses, K, C):  # type: ignore[no-untyped-def]
    """Returns the lower triangular L with `L L' = M + weight C + weight² K`, and writes the tangents into K and C."""
    tangents(x, v, p, place, np.bool_(True), K, C)  # not a literal, so that it is compiled once
    M = weight * C + (weight * weight) * K
    for r in range(len(masses)):
        M[r, r] += masses[r]
    return np.linalg.cholesky(M)


@njit(cache=True, nogil=True)
def _newton(now, target, weight, L, renew, place, nodes, free, masses, p, outside, scratch):  # type: ignore[no-untyped-def]
    """Solve `(q, v) = target + weight (v, a(q, v))` by Newton iterations; `now` is the first guess, then the solution.

    L: factor of the tangents near the solution, see `_factorise`
    renew: whether each iteration computes L again; if not, L is kept until an iteration does not contract
    """
    x, v, force, pull, square, K, C = scratch
    dim, n_half = nodes.shape[1], len(masses)
    changed = np.empty(n_half)
    before = 0.0
    for iteration in range(MOST_NEWTON):
        for r in range(n_half):
            x[free[r // dim], r % dim, 0] = now[r]
            v[free[r // dim], r % dim, 0] = now[n_half + r]
        if renew:
            L = _factorise(x, v, p, place, weight, masses, K, C)
        spring_forces(x, v, p, pull, square, force)
        missing = target[:n_half] + weight * now[n_half:] - now[:n_half]
        along = K @ missing
        for r in range(n_half):
            pushed = force[free[r // dim], r % dim, 0] + outside[r] - along[r]
            changed[r] = masses[r] * (target[n_half + r] - now[n_half + r]) + weight * pushed
        _solve_triangles(L, changed)
        for r in range(n_half):
            now[r] += missing[r] + weight * changed[r]
            now[n_half + r] += changed[r]
        size = np.abs(changed).max()
        still = weight * size <= STILL * np.abs(now[:n_half]).max()
        contracted = iteration > 0 and (still or size <= CONTRACTED * before)
        if iteration >= NEWTON - 1 and contracted:
            break
        renew = renew or (iteration > 0 and not contracted)
        before = size


@njit(cache=True, nogil=True)
def implicit_steps(states, outside, dt, n_steps, renew, nodes, free, masses, p):  # type: ignore[no-untyped-def]
    """States after n_steps steps of dt by TR-BDF2, (n_points, n_state).

    outside: as in `runge_kutta`; masses: masses of free coordinates, (n_half,)
    renew: whether each Newton iteration computes new tangents; if not, all use the tangents at the step's start
    The two stages are the trapezoidal rule and the backward differentiation formula. The method has second order and,
    with definite tangents, is stable at any stiffness.
    """
    n_points = states.shape[0]
    n_nodes, dim = nodes.shape
    n_half = free.shape[0] * dim
    x, v, force = np.empty((n_nodes, dim, 1)), np.zeros((n_nodes, dim, 1)), np.empty((n_nodes, dim, 1))
    place = np.full(n_nodes, -1)
    for f in range(free.shape[0]):
        place[free[f]] = f * dim
    K, C = np.empty((n_half, n_half)), np.empty((n_half, n_half))
    pull, square = np.empty(1), np.empty(1)
    scratch = (x, v, force, pull, square, K, C)
    ended = states.copy()
    g = TR_BDF2
    weight = 0.5 * g * dt
    second, first = 1.0 / (g * (2.0 - g)), (1.0 - g) ** 2 / (g * (2.0 - g))
    target, before = np.empty(2 * n_half), np.empty(2 * n_half)
    for i in range(n_nodes):
        for d in range(dim):
            x[i, d, 0] = nodes[i, d]
    for q in range(n_points):
        now = ended[q]
        for _ in range(n_steps):
            for r in range(n_half):
                x[free[r // dim], r % dim, 0] = now[r]
                v[free[r // dim], r % dim, 0] = now[n_half + r]
            L = _factorise(x, v, p, place, weight, masses, K, C)
            spring_forces(x, v, p, pull, square, force)
            for r in range(n_half):
                before[r], before[n_half + r] = now[r], now[n_half + r]
                target[r] = now[r] + weight * now[n_half + r]
                pushed = force[free[r // dim], r % dim, 0] + outside[q, r]
                target[n_half + r] = now[n_half + r] + weight * pushed / masses[r]
                now[r] += g * dt * before[n_half + r]
            _newton(now, target, weight, L, renew, place, nodes, free, masses, p, outside[q], scratch)
            for r in range(2 * n_half):
                target[r] = second * now[r] - first * before[r]
            for r in range(n_half):
                now[r] += (1.0 - g) * dt * now[n_half + r]
            _newton(now, target, weight, L, renew, place, nodes, free, masses, p, outside[q], scratch)
    return ended


@njit(cache=True, nogil=True)
def tangents_each(states, definite, nodes, free, p):  # type: ignore[no-untyped-def]
    """Matrices K and C of `tangents`, each (n_points, n_half, n_half), at states (n_points, n_state)."""
    n_points = states.shape[0]
    n_nodes, dim = nodes.shape
    n_half = free.shape[0] * dim
    x, v = np.empty((n_nodes, dim, 1)), np.zeros((n_nodes, dim, 1))
    place = np.full(n_nodes, -1)
    for f in range(free.shape[0]):
        place[free[f]] = f * dim
    for i in range(n_nodes):
        for d in range(dim):
            x[i, d, 0] = nodes[i, d]
    Ks, Cs = np.empty((n_points, n_half, n_half)), np.empty((n_points, n_half, n_half))
    for q in range(n_points):
        for r in range(n_half):
            x[free[r // dim], r % dim, 0] = states[q, r]
            v[free[r // dim], r % dim, 0] = states[q, n_half + r]
        tangents(x, v, p, place, definite, Ks[q], Cs[q])
    return Ks, Cs


class PackedNeedle(NamedTuple):
    """A needle's constants for `steered_steps`; see `dynamics.needle.loads.NeedleMechanics`."""

    puncture: float
    contact: float
    cutting: float
    friction: float
    reach: float
    slip: float


@njit(cache=True, nogil=True)
def _share(nodes, point, reach, share):  # type: ignore[no-untyped-def]
    """Write each node's share of a unit force at a point into `share`, (n_nodes,)."""
    n_nodes, dim = nodes.shape
    nearest = np.inf
    for i in range(n_nodes):
        share[i] = 0.0
        for d in range(dim):
            share[i] += (point[d] - nodes[i, d]) ** 2
        nearest = min(nearest, share[i])
    total = 0.0
    for i in range(n_nodes):
        share[i] = np.exp(-0.5 * (share[i] - nearest) / (reach * reach))
        total += share[i]
    for i in range(n_nodes):
        share[i] /= total


@njit(cache=True, nogil=True)
def _needle_forces(x, v, nodes, needle, at, punctured, shaft, share, force):  # type: ignore[no-untyped-def]
    """Add the needle's force to `force` (n_nodes, dim, 1); returns the contact force [N] before the puncture, else 0.

    at: the needle's tip (dim,), its direction (dim,), its speed along this direction, its length in the tissue
    """
    tip, u, speed, inserted = at
    n_nodes, dim = nodes.shape
    point = np.empty(dim)
    if not punctured:
        for d in range(dim):
            point[d] = tip[d] - inserted * u[d]
        _share(nodes, point, needle.reach, share)
        dent = inserted
        for i in range(n_nodes):
            for d in range(dim):
                dent -= share[i] * (x[i, d, 0] - nodes[i, d]) * u[d]
        axial = contact_force(dent, needle.contact)
        for i in range(n_nodes):
            for d in range(dim):
                force[i, d, 0] += axial * share[i] * u[d]
        return axial
    for q in range(shaft.shape[1] + 1):
        most = needle.cutting
        back = 0.0
        if q > 0:
            back = 0.5 * inserted * (shaft[0, q - 1] + 1.0)
            most = needle.friction * 0.5 * inserted * shaft[1, q - 1]
        for d in range(dim):
            point[d] = tip[d] - back * u[d]
        _share(nodes, point, needle.reach, share)
        slide = speed
        for i in range(n_nodes):
            for d in range(dim):
                slide -= share[i] * v[i, d, 0] * u[d]
        axial = sliding_force(slide, most, needle.slip)
        if q == 0:
            axial = max(0.0, axial)
        for i in range(n_nodes):
            for d in range(dim):
                force[i, d, 0] += axial * share[i] * u[d]
    return 0.0


@njit(cache=True, nogil=True)
def steered_steps(state, samples, place, dt, n_steps, nodes, free, inverse_mass, p, needle, moves, punctured, shaft):  # type: ignore[no-untyped-def]
    """State after n_steps Runge-Kutta steps of dt under sampled forces and a needle, and whether the skin is punctured.

    samples: forces on the free coordinates [N], (n_samples, n_free dim), interpolated linearly
    place: time at the start and length of a step, both divided by the interval between samples
    moves: tip (dim,), velocity (dim,), direction (dim,) and inserted length of the needle, at the start
    punctured: whether the skin is punctured at the start
    """
    n_nodes, dim = nodes.shape
    n_half = free.shape[0] * dim
    x, v, force = np.empty((n_nodes, dim, 1)), np.zeros((n_nodes, dim, 1)), np.empty((n_nodes, dim, 1))
    pull, square, share = np.empty(1), np.empty(1), np.empty(n_nodes)
    start, total, tip = state.copy(), np.empty(2 * n_half), np.empty(dim)
    first, velocity, u, inserted = moves
    speed = 0.0
    for d in range(dim):
        speed += velocity[d] * u[d]
    for i in range(n_nodes):
        for d in range(dim):
            x[i, d, 0] = nodes[i, d]
    for step in range(n_steps):
        for r in range(n_half):
            x[free[r // dim], r % dim, 0] = start[r]
            v[free[r // dim], r % dim, 0] = start[n_half + r]
        total[:] = 0.0
        for stage in range(4):
            done = step + (0.0 if stage == 0 else (1.0 if stage == 3 else 0.5))
            for d in range(dim):
                tip[d] = first[d] + done * dt * velocity[d]
            spring_forces(x, v, p, pull, square, force)
            length = inserted + done * dt * speed
            contact = 0.0
            if length > 0.0:
                at = (tip, u, speed, length)
                contact = _needle_forces(x, v, nodes, needle, at, punctured, shaft, share, force)
            where = min(max(place[0] + done * place[1], 0.0), samples.shape[0] - 1.000001)
            k = int(where)
            part = where - k
            by = dt / 6.0 if stage in (0, 3) else dt / 3.0
            ahead = dt if stage == 2 else dt / 2.0
            for r in range(n_half):
                i, d = free[r // dim], r % dim
                outside = (1.0 - part) * samples[k, r] + part * samples[k + 1, r]
                moved = v[i, d, 0]
                acceleration = (force[i, d, 0] + outside) * inverse_mass[i]
                total[r] += by * moved
                total[n_half + r] += by * acceleration
                x[i, d, 0] = start[r] + ahead * moved
                v[i, d, 0] = start[n_half + r] + ahead * acceleration
        if contact >= needle.puncture:
            punctured = True
        for r in range(2 * n_half):
            start[r] += total[r]
    return start, punctured


@njit(cache=True, nogil=True)
def parameter_forces_each(states, nodes, p, kinds, indices, free):  # type: ignore[no-untyped-def]
    """Derivatives of forces on free coordinates with respect to logs of n constants [N], (n_points, n, n_state / 2).

    states: (n_points, n_state); nodes: positions of all nodes [m], (n_nodes, dim), of which only anchors are used
    kinds: index of each constant's kind in KINDS, (n,); indices: index of the constant's spring or node, (n,)
    """
    half = states.shape[1] // 2
    dim = nodes.shape[1]
    forces = np.zeros((states.shape[0], kinds.shape[0], half))
    x, v = nodes.copy(), np.zeros(nodes.shape)
    for q in range(states.shape[0]):
        for r in range(half):
            x[free[r // dim], r % dim] = states[q, r]
            v[free[r // dim], r % dim] = states[q, half + r]
        _write_parameter_forces(x, v, p, kinds, indices, free, forces[q])
    return forces


@njit(cache=True, nogil=True)
def _write_parameter_forces(x, v, p, kinds, indices, free, out):  # type: ignore[no-untyped-def]
    """Add the result of `parameter_forces_each` for one state to `out`, `(n, n_free dim)`, an array of zeros."""
    dim = x.shape[1]
    for k in range(kinds.shape[0]):
        kind, s = kinds[k], indices[k]
        square, along = 0.0, 0.0
        if kind < N_OF_SPRINGS:
            i, j = p.springs[s, 0], p.springs[s, 1]
            for d in range(dim):
                apart = x[j, d] - x[i, d]
                square += apart * apart
                along += apart * (v[j, d] - v[i, d])
            length = np.sqrt(square + SHORTEST * SHORTEST)
            tension = tension_by_log_constants(length, along / length, _of_spring(p, s))[kind]
            for a in range(free.shape[0]):
                sign = 1.0 if free[a] == i else (-1.0 if free[a] == j else 0.0)
                for d in range(dim):
                    out[k, a * dim + d] += sign * tension * (x[j, d] - x[i, d]) / length
        else:
            for d in range(dim):
                square += v[s, d] * v[s, d]
            resistance = resistance_by_log_constants(square, _of_node(p, s))[kind - N_OF_SPRINGS]
            for a in range(free.shape[0]):
                if free[a] == s:
                    for d in range(dim):
                        out[k, a * dim + d] = -resistance * v[s, d]
