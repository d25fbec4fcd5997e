"""A part of the tissue that turns while none of its springs lengthens: in which directions, and beliefs moved so."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynamics import MassSpringNetwork, all_positions
from estimators.arrays import Floats

RIGID = 1e-6
"""Lengthening by the largest in which a motion is one without; numerical."""

STEP_RAD = 0.1
"""Links turn by no more at once [rad]; numerical."""

NEWTON = 4
"""Steps of Newton's method back to the lengths of links, of an error of half of `STEP_RAD` squared; numerical."""

LOOSE = 1e-4
"""Compliance of springs by that of the part's nodes [1], so that none divides by nothing where they are stretched out;
numerical."""


def turnings(network: MassSpringNetwork, rows: NDArray[np.intp], mean: Floats) -> Floats:
    """Directions of a state in which the part's springs turn and do not lengthen, the fastest by 1 rad, (k, n).

    rows: of the part's coordinates in the state; mean (n,)
    """
    half = network.n_state // 2
    lengthening, turning, _ = _rates(network, mean[:half])
    own = lengthening[:, rows]
    _, sizes, right = np.linalg.svd(own)
    found = np.zeros((len(rows) - int((sizes > RIGID * sizes[0]).sum()), len(mean)))
    found[:, rows] = right[len(right) - len(found) :]
    fastest = np.linalg.norm(np.einsum("sdn,kn->ksd", turning, found[:, :half]), axis=2).max(axis=1)
    return np.asarray(found / fastest[:, None])


def angle_between(network: MassSpringNetwork, one: Floats, other: Floats) -> float:
    """The largest angle by which a spring is turned from one state to another [rad], each (n,)."""
    half = network.n_state // 2
    u, v = (_rates(network, x[:half])[2] for x in (one, other))
    return float(np.arccos(np.clip((u * v).sum(axis=1), -1.0, 1.0)).max())


def turned(
    network: MassSpringNetwork, rows: NDArray[np.intp], belief: tuple[Floats, Floats, Floats], way: Floats
) -> tuple[Floats, Floats, Floats]:
    """A belief, mean (n,), cov (n, n) and columns (n, r), moved along one of the part's `turnings`, times an angle.

    way: that direction times the angle of the spring that turns the most [rad], (n,)
    In steps of `STEP_RAD` that follow the links round. Lengths and their rates stay; covariance and columns turn along,
    to first order, so that what they tell of lengths and rates stays, too.
    """
    half, (mean, cov, columns) = network.n_state // 2, belief
    freedom = np.full(half, LOOSE)
    freedom[rows] = 1.0
    angle = _fastest(network, mean, way)
    n_steps, T = max(1, int(np.ceil(angle / STEP_RAD))), np.eye(len(mean))
    for _ in range(n_steps):
        onwards = T @ way
        mean, own = _step(network, mean, onwards * angle / n_steps / _fastest(network, mean, onwards), freedom)
        T = own @ T
    return mean, T @ cov @ T.T, T @ columns


def _fastest(network: MassSpringNetwork, mean: Floats, way: Floats) -> float:
    """The angle by which the spring that turns the most does so along a way, to first order [rad]."""
    half = network.n_state // 2
    turning = _rates(network, mean[:half])[1]
    return float(np.linalg.norm(np.einsum("sdn,n->sd", turning, way[:half]), axis=1).max())


def _step(network: MassSpringNetwork, mean: Floats, way: Floats, freedom: Floats) -> tuple[Floats, Floats]:
    """A state (n,) moved a short way (n,) and back to its lengths and rates; the derivative by the state, (n, n)."""
    half = network.n_state // 2
    straight = mean + way
    J0, _, _ = _rates(network, mean[:half])
    lengths, place = _lengths(network, mean[:half]), straight[:half]
    for _ in range(NEWTON):
        J, _, _ = _rates(network, place)
        gain = _gain(J, freedom)
        place = straight[:half] + gain @ (lengths - _lengths(network, place) + J @ (place - straight[:half]))
    J, _, _ = _rates(network, place)
    gain = _gain(J, freedom)
    before = mean[half : 2 * half]
    speed = before + gain @ (J0 @ before - J @ before)
    by_place0, by_place = _rates_by_place(network, mean[:half], before), _rates_by_place(network, place, speed)
    T = np.eye(len(mean))
    T[:half, :half] += gain @ (J0 - J)
    T[half : 2 * half, half : 2 * half] = T[:half, :half]
    T[half : 2 * half, :half] = gain @ (by_place0 - by_place @ T[:half, :half])
    moved = straight.copy()
    moved[:half], moved[half : 2 * half] = place, speed
    return moved, T


def _gain(J: Floats, freedom: Floats) -> Floats:
    """Motion of the free coordinates for each lengthening of a spring, (half, n_springs), by where they are free."""
    weighed = J * freedom
    return np.asarray(np.linalg.solve(weighed @ J.T + LOOSE * np.eye(len(J)), weighed).T)


def _ends(network: MassSpringNetwork, place: Floats) -> tuple[Floats, Floats]:
    """Vectors along the springs, (n_springs, dim), and their lengths."""
    positions = all_positions(network, place.reshape(-1, network.dim))
    along = positions[network.springs[:, 1]] - positions[network.springs[:, 0]]
    return along, np.linalg.norm(along, axis=1)


def _lengths(network: MassSpringNetwork, place: Floats) -> Floats:
    return _ends(network, place)[1]


def _rates(network: MassSpringNetwork, place: Floats) -> tuple[Floats, Floats, Floats]:
    """Of free coordinates, lengthening of each spring (n_springs, half), turning (n_springs, dim, half), and axes."""
    along, lengths = _ends(network, place)
    axes = along / lengths[:, None]
    across = (np.eye(network.dim) - axes[:, :, None] * axes[:, None, :]) / lengths[:, None, None]
    return _of_springs(network, axes[:, None])[:, 0], _of_springs(network, across), axes


def _rates_by_place(network: MassSpringNetwork, place: Floats, speed: Floats) -> Floats:
    """Derivative of the springs' lengthening at this speed by the place, (n_springs, half)."""
    turning = _rates(network, place)[1]
    return _of_springs(network, np.einsum("sdn,n->sd", turning, speed)[:, None])[:, 0]


def _of_springs(network: MassSpringNetwork, by_end: Floats) -> Floats:
    """What acts on a spring's second end, less on its first, (n_springs, k, dim), by free coordinates (.., k, half)."""
    n, k, dim = by_end.shape
    found = np.zeros((n, k, network.n_nodes, dim))
    i, j = network.springs.T
    found[np.arange(n), :, j] += by_end
    found[np.arange(n), :, i] -= by_end
    return found[:, :, network.free].reshape(n, k, -1)
