"""Compiled spring forces and Runge-Kutta steps over a batch of states.

Arrays are node-major with the batch last, (n_nodes, dim, n_points), so that the innermost loop runs over
neighbouring numbers and the compiler can take several states at a time. Nothing here checks its input:
`dynamics.forces.energy` and `dynamics.integration.stepping` are the doors.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit

from dynamics.arrays import Floats
from dynamics.network.mass_spring import MassSpringNetwork

SLIP_VELOCITY = 5e-3
"""Speed over which Coulomb friction builds up [m/s]; chosen: dry friction has a jump there, a filter cannot."""

SHORTEST = 1e-9
"""Length below which a spring has no direction and pushes nowhere [m]."""


class Packed(NamedTuple):
    """The network as the kernels read it; see `MassSpringNetwork` for units."""

    springs: np.ndarray
    stiffness: Floats
    rest_lengths: Floats
    damping: Floats
    weight: Floats
    drag: Floats
    friction: Floats


@lru_cache(maxsize=64)
def packed(network: MassSpringNetwork) -> Packed:
    """The network's arrays in the order that the kernels take them; weight [N], shape (n_nodes, dim)."""
    weight = np.where(network.fixed[:, None], 0.0, network.masses[:, None] * network.gravity)
    return Packed(
        network.springs,
        network.stiffness,
        network.rest_lengths,
        network.damping,
        weight,
        network.drag,
        network.friction,
    )


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz", "arcp"})
def spring_forces(x, v, p, pull, square, force):  # type: ignore[no-untyped-def]
    """Write the force on each node [N] into `force`, (n_nodes, dim, n_points); pull, square: scratch, (n_points,)."""
    n_nodes, dim, n_points = x.shape
    for i in range(n_nodes):
        for q in range(n_points):
            square[q] = SLIP_VELOCITY * SLIP_VELOCITY
        for d in range(dim):
            for q in range(n_points):
                square[q] += v[i, d, q] * v[i, d, q]
        for d in range(dim):
            for q in range(n_points):
                resist = p.drag[i] + p.friction[i] / np.sqrt(square[q])
                force[i, d, q] = p.weight[i, d] - resist * v[i, d, q]
    for s in range(p.springs.shape[0]):
        i, j = p.springs[s, 0], p.springs[s, 1]
        k, rest, c = p.stiffness[s], p.rest_lengths[s], p.damping[s]
        for q in range(n_points):
            square[q] = SHORTEST * SHORTEST
            pull[q] = 0.0
        for d in range(dim):
            for q in range(n_points):
                apart = x[j, d, q] - x[i, d, q]
                square[q] += apart * apart
                pull[q] += apart * (v[j, d, q] - v[i, d, q])
        for q in range(n_points):
            # Tension over length: (k (l - l0) + c dl/dt) / l
            inverse = 1.0 / np.sqrt(square[q])
            pull[q] = k - k * rest * inverse + c * pull[q] * inverse * inverse
        for d in range(dim):
            for q in range(n_points):
                f = pull[q] * (x[j, d, q] - x[i, d, q])
                force[i, d, q] += f
                force[j, d, q] -= f


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz", "arcp"})
def runge_kutta(states, outside, dt, n_steps, nodes, free, inverse_mass, p):  # type: ignore[no-untyped-def]
    """States after n_steps classical Runge-Kutta steps of dt, (n_points, n_state).

    outside: force on each free coordinate, held during the steps [N], (n_points, n_free dim)
    nodes: where all nodes stand, of which only the anchors are used [m], (n_nodes, dim)
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


class PackedNeedle(NamedTuple):
    """A needle's constants as `steered_steps` reads them; see `dynamics.needle.loads.Needle`."""

    puncture: float
    contact: float
    cutting: float
    friction: float
    reach: float
    slip: float


@njit(cache=True, nogil=True)
def _share(nodes, point, reach, share):  # type: ignore[no-untyped-def]
    """Write the part that each node takes of a force at a point into `share`, (n_nodes,)."""
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
    """Add the needle's push to `force` (n_nodes, dim, 1); gives the contact force [N] before the puncture, else 0.

    at: tip (dim,), direction (dim,), speed along it, length in the tissue
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
        push = needle.contact * max(0.0, dent)
        for i in range(n_nodes):
            for d in range(dim):
                force[i, d, 0] += push * share[i] * u[d]
        return push
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
        push = most * slide / np.sqrt(slide * slide + needle.slip * needle.slip)
        if q == 0:
            push = max(0.0, push)
        for i in range(n_nodes):
            for d in range(dim):
                force[i, d, 0] += push * share[i] * u[d]
    return 0.0


@njit(cache=True, nogil=True)
def steered_steps(state, knots, place, dt, n_steps, nodes, free, inverse_mass, p, needle, moves, punctured, shaft):  # type: ignore[no-untyped-def]
    """State after n_steps Runge-Kutta steps of dt under forces told by knots and a needle, and whether it is punctured.

    knots: forces on the free coordinates [N], (n_knots, n_free dim), straight between
    place: where now is among the knots, and how long a step is, in knots
    moves: tip (dim,) and its velocity (dim,), direction (dim,), length in the tissue now; punctured: so far
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
            where = min(max(place[0] + done * place[1], 0.0), knots.shape[0] - 1.000001)
            k = int(where)
            part = where - k
            by = dt / 6.0 if stage in (0, 3) else dt / 3.0
            ahead = dt if stage == 2 else dt / 2.0
            for r in range(n_half):
                i, d = free[r // dim], r % dim
                outside = (1.0 - part) * knots[k, r] + part * knots[k + 1, r]
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
def write_parameter_forces(x, v, p, kinds, indices, free, out):  # type: ignore[no-untyped-def]
    """Write what a change of the log of each constant adds to the force on the free coordinates [N] into `out`.

    x, v: of all nodes, (n_nodes, dim); kinds, indices: of the constants as in `dynamics.forces.parameters`
    out: (n, n_free dim)
    """
    dim = x.shape[1]
    out[:] = 0.0
    for k in range(kinds.shape[0]):
        kind, s = kinds[k], indices[k]
        if kind < 3:
            i, j = p.springs[s, 0], p.springs[s, 1]
            square, along = 0.0, 0.0
            for d in range(dim):
                apart = x[j, d] - x[i, d]
                square += apart * apart
                along += apart * (v[j, d] - v[i, d])
            length = np.sqrt(square)
            tension = p.stiffness[s] * (length - p.rest_lengths[s])
            if kind == 1:
                tension = -p.stiffness[s] * p.rest_lengths[s]
            elif kind == 2:
                tension = p.damping[s] * along / length
            for a in range(free.shape[0]):
                sign = 1.0 if free[a] == i else (-1.0 if free[a] == j else 0.0)
                for d in range(dim):
                    out[k, a * dim + d] += sign * tension * (x[j, d] - x[i, d]) / length
        else:
            square = SLIP_VELOCITY * SLIP_VELOCITY
            for d in range(dim):
                square += v[s, d] * v[s, d]
            resist = p.drag[s] if kind == 3 else p.friction[s] / np.sqrt(square)
            for a in range(free.shape[0]):
                if free[a] == s:
                    for d in range(dim):
                        out[k, a * dim + d] = -resist * v[s, d]
