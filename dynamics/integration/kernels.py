"""Compiled algebra of the implicit step in `dynamics.integration.rosenbrock`.

In this module, h is the step, g = gamma h, J the Jacobian of the equations of motion, K the stiffness, and C the
damping. The matrix `S = (M + g C + g² K)^-1` gives products of `(1 - g J)^-1` with vectors.
"""

from __future__ import annotations

import numpy as np
from numba import njit

GAMMA = 1.0 - 1.0 / np.sqrt(2.0)
TWICE, ONCE = (1.0 - GAMMA) / GAMMA, -(1.0 - 2.0 * GAMMA) / GAMMA
"""Coefficients of the stability function `TWICE A² + ONCE A`, with `A = (1 - g J)^-1`."""


@njit(cache=True, nogil=True)
def _resolved(S, K, M, g, of_q, of_v):  # type: ignore[no-untyped-def]
    """Product of `(1 - g J)^-1`, see the module, and a vector, (2 n,), whose halves are of_q and of_v, (n,) each."""
    speed = S @ (M * of_v - g * (K @ of_q))
    return np.concatenate((of_q + g * speed, speed))


@njit(cache=True, nogil=True)
def first_stage(state, h, force, K, C, M, B, rates):  # type: ignore[no-untyped-def]
    """First stage of a step; returns S, (n, n), then `first`, `first_f` and `middle` for `second_stage`."""
    n, g = len(M), GAMMA * h
    matrix = np.diag(M) + g * C + g * g * K
    is_finite = np.isfinite(matrix).all()
    S = np.linalg.inv(matrix if is_finite else np.eye(n))
    if not is_finite:  # the moved state then contains NaN, which the caller detects
        S[:] = np.nan
    v, f = state[n : 2 * n], state[2 * n :]
    faded = -rates * f / (1.0 + g * rates)
    stage = _resolved(S, K, M, g, v, force / M + B @ (f + g * faded))
    return S, stage, faded, state[: 2 * n] + h * stage


@njit(cache=True, nogil=True)
def second_stage(state, h, first, first_f, middle, force, S, K, M, B, rates):  # type: ignore[no-untyped-def]
    """State after the step, and the largest difference of a coordinate between the two stages [m].

    first, first_f: slopes of coordinates and velocities, (2 n,), and of decaying forces, (n_f,), in the first stage
    middle: coordinates and velocities after the first stage, (2 n,); force: force at `middle` [N], (n,)
    """
    n, g = len(M), GAMMA * h
    f = state[2 * n :]
    second_f = (-rates * (f + h * first_f) - 2.0 * first_f) / (1.0 + g * rates)
    pull = force / M + B @ (f + h * first_f + g * second_f)
    second = _resolved(S, K, M, g, middle[n:] - 2.0 * first[:n], pull - 2.0 * first[n:])
    moved = state + h * np.concatenate((1.5 * first + 0.5 * second, 1.5 * first_f + 0.5 * second_f))
    return moved, np.abs(0.5 * h * (first + second)[:n]).max()


@njit(cache=True, nogil=True)
def _put(found, start, once, speeds, g):  # type: ignore[no-untyped-def]
    """Write derivatives of coordinates and velocities, (2 n, k), into k columns of `found`, from column `start` on."""
    n, k = once.shape
    for i in range(n):
        for j in range(k):
            found[i, start + j] = g * (speeds[i, j] + TWICE * once[i, j])
            found[n + i, start + j] = speeds[i, j]


@njit(cache=True, nogil=True)
def by_state(h, S, K, M, B, rates):  # type: ignore[no-untyped-def]
    """Derivative of coordinates and velocities after a step with respect to the state before it, (2 n, n_state)."""
    n, g = len(M), GAMMA * h
    kept = 1.0 / (1.0 + g * rates)
    X, Y = -g * (S @ K), S * M
    Z, F = g * X + Y, g * kept * (Y @ B)
    found = np.empty((2 * n, 2 * n + len(rates)))
    _put(found, 0, X, TWICE * (X + Z @ X) + ONCE * X, g)
    _put(found, n, Y, TWICE * (Z @ Y) + ONCE * Y, g)
    _put(found, 2 * n, F, TWICE * (Z @ F + F * kept) + ONCE * F, g)
    for i in range(n):
        found[i, i] += TWICE + ONCE
    return found


@njit(cache=True, nogil=True)
def by_push(h, S, K, M, pushes):  # type: ignore[no-untyped-def]
    """Change of coordinates and velocities over a step, (2 n, k), due to each of k constant accelerations, (n, k)."""
    n, g = len(M), GAMMA * h
    once = g * (S @ (M.reshape(n, 1) * pushes))
    twice = once + S @ (M.reshape(n, 1) * once - g * g * (K @ once))
    found = np.empty((2 * n, pushes.shape[1]))
    _put(found, 0, once, TWICE * twice + ONCE * once, g)
    return found


@njit(cache=True, nogil=True)
def _add(to, columns, scale):  # type: ignore[no-untyped-def]
    """Add `scale C C'` to the first k rows and columns of the matrix `to`, with C = columns, (k, any)."""
    squares = columns @ columns.T
    for i in range(len(squares)):
        for j in range(len(squares)):
            to[i, j] += scale * squares[i, j]


@njit(cache=True, nogil=True)
def along_steps(by_states, fadings, steps_s, sources, n_sources, white):  # type: ignore[no-untyped-def]
    """Jacobian over all steps (2 n, m), decay factors of forces (n_f,), noise covariances (1 + n_sources, m, m).

    The m states are n positions, n velocities and n_f decaying forces. The first covariance is due to white noise on
    the velocities. Each further covariance is due to all forces of one source, each of which has variance 1.
    by_states, fadings, steps_s: Jacobian (2 n, m), decay factors (n_f,) and length [s] of each of n_steps steps
    sources (n_f,): index of each force's source; white (n,): standard deviation of each velocity's white noise
    """
    n_steps, moving, m = by_states.shape
    half = moving // 2
    motion, force = np.eye(moving, m), np.ones(m - moving)  # Jacobians of the motion from a step to the end
    noises = np.zeros((1 + n_sources, m, m))
    for step in range(n_steps - 1, -1, -1):
        if step == n_steps - 1:  # the last step
            for f in range(m - moving):
                noises[1 + sources[f], moving + f, moving + f] = 1.0 - fadings[step, f] ** 2
            before = by_states[step].copy()
        else:
            before = np.ascontiguousarray(motion[:, :moving]) @ by_states[step]
            drive = np.sqrt(1.0 - fadings[step] ** 2)
            driven = motion[:, moving:] * drive
            for i in range(moving):  # by loops: a sum over slices takes six seconds longer to compile
                for f in range(m - moving):
                    before[i, moving + f] += motion[i, moving + f] * fadings[step, f]
            for source in range(n_sources):
                _add(noises[1 + source], driven[:, sources == source], 1.0)
            for f in range(m - moving):
                noise, kept = noises[1 + sources[f]], force[f] * drive[f]
                noise[moving + f, moving + f] += kept**2
                for i in range(moving):
                    noise[i, moving + f] += driven[i, f] * kept
                    noise[moving + f, i] += driven[i, f] * kept
        # Simpson's rule over the step, with F and L the noise at its start and end: F F' + (F + L) (F + L)' + L L'
        first, last = before[:, half:moving] * white, motion[:, half:moving] * white
        _add(noises[0], np.sqrt(2.0) * first + np.sqrt(0.5) * last, steps_s[step] / 6.0)
        _add(noises[0], np.sqrt(1.5) * last, steps_s[step] / 6.0)
        motion, force = before, force * fadings[step]
    return motion, force, noises
