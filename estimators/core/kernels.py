"""Compiled loops of the filter: motion and noise of several steps together, and likelihoods of withheld marks."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _add(to, columns, scale):  # type: ignore[no-untyped-def]
    """Add scale times C C' to the leading k x k block of a matrix, with C the `columns`, (k, any)."""
    squares = columns @ columns.T
    for i in range(len(squares)):
        for j in range(len(squares)):
            to[i, j] += scale * squares[i, j]


@njit(cache=True, nogil=True)
def along_steps(by_states, fadings, steps_s, sources, n_sources, white):  # type: ignore[no-untyped-def]
    """Jacobian of the motion (2 n, m), decay of forces (n_f,), noises (1 + n_sources, m, m).

    The m states are n positions, n velocities and n_f forces that only decay. Noises have unit variance: white noise of
    velocities, then the noise of each source of forces; sources (n_f,): index of each force's source.
    by_states (n_steps, 2 n, m), fadings (n_steps, n_f): derivatives of each step; steps_s (n_steps,): their lengths [s]
    white (n,): standard deviation of the white noise of each velocity
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
            driven = np.zeros((m, m - moving))
            before = np.ascontiguousarray(motion[:, :moving]) @ by_states[step]
            for f in range(m - moving):
                driven[moving + f, f] = force[f]
                for i in range(moving):
                    driven[i, f] = motion[i, moving + f]
                    before[i, moving + f] += motion[i, moving + f] * fadings[step, f]
            driven *= np.sqrt(1.0 - fadings[step] ** 2)
            for source in range(n_sources):
                _add(noises[1 + source], driven[:, sources == source], 1.0)
        # Simpson's rule over the time of the noise in the step: F F' + (F + L) (F + L)' + L L', first and last
        first, last = before[:, half:moving] * white, motion[:, half:moving] * white
        _add(noises[0], np.sqrt(2.0) * first + np.sqrt(0.5) * last, steps_s[step] / 6.0)
        _add(noises[0], np.sqrt(1.5) * last, steps_s[step] / 6.0)
        motion, force = before, force * fadings[step]
    return motion, force, noises


@njit(cache=True, nogil=True)
def withheld_log_likelihoods(S, innovation, rows, ends, own):  # type: ignore[no-untyped-def]
    """For each S (k, m, m), the sum over groups of the log likelihood of some rows given the rows outside the group.

    With W = S^-1, the other rows predict rows g with the error W_gg^-1 (W y)_g, whose covariance is W_gg^-1. With W_gg
    = L L' and the counted rows last, the last block of L gives error and covariance.
    rows (any,): rows of the groups in turn; ends (n_groups,): end of each; own (n_groups,): number of rows that count
    """
    totals = np.zeros(len(S))
    for k in range(len(S)):
        W = np.linalg.inv(S[k])
        weighted, start = W @ innovation, 0
        for group in range(len(ends)):
            g = rows[start : ends[group]][::-1]
            block = np.empty((len(g), len(g)))
            for row in range(len(g)):
                for column in range(len(g)):
                    block[row, column] = W[g[row], g[column]]
            root, white = np.linalg.cholesky(block), weighted[g]
            for row in range(len(g)):
                white[row] = (white[row] - root[row, :row] @ white[:row]) / root[row, row]
                if row >= len(g) - own[group]:
                    totals[k] += np.log(root[row, row]) - 0.5 * white[row] ** 2
            start = ends[group]
    return totals


@njit(cache=True, nogil=True)
def has_outlier(root, white, ends, logs):  # type: ignore[no-untyped-def]
    """Whether each hypothesis finds an outlier, (k,); ends and logs are those of `without_outliers`.

    root (k, m, m), white (k, m): inverse of the lower Cholesky factor of S, and its product with the innovation
    """
    found = np.zeros(len(root), dtype=np.bool_)
    for k in range(len(root)):
        first = 0
        for block in range(len(ends)):
            rows = slice(first, ends[block])
            own = np.ascontiguousarray(root[k, first:, rows])
            first = ends[block]
            if not np.isfinite(logs[block]):
                continue
            weighted, information = own.T @ white[k, rows.start :], own.T @ own
            if _gain(weighted, information, logs[block]) > 0.0:
                found[k] = True
                break
    return found


@njit(cache=True, nogil=True)
def _gain(weighted, information, log):  # type: ignore[no-untyped-def]
    """Log of the ratio of two densities of a block: as an outlier, and as predicted from the other blocks."""
    misfit = weighted @ np.linalg.solve(information, weighted)
    return log + 0.5 * (misfit - np.log(np.linalg.det(information)) + len(weighted) * np.log(2.0 * np.pi))


@njit(cache=True, nogil=True)
def without_outliers(y, S, ends, logs, far):  # type: ignore[no-untyped-def]
    """Outlier blocks of each hypothesis, (k, n_blocks), and the sum of their log densities, (k,).

    y (k, m), S (k, m, m): innovations and covariances; outliers get innovation zero and variance `far`
    ends (n_blocks,): end of each block's rows; logs (n_blocks,): log density of each block as an outlier

    The block that the others contradict most is removed first, until no block is more probable as an outlier. With W =
    S^-1, the other rows predict rows g with the error W_gg^-1 (W y)_g, whose covariance is W_gg^-1.
    """
    n_blocks = len(ends)
    out, added = np.zeros((len(y), n_blocks), dtype=np.bool_), np.zeros(len(y))
    for k in range(len(y)):
        for _ in range(n_blocks):
            W = np.linalg.inv(S[k])
            weighted = W @ y[k]
            most, worst, first = 0.0, -1, 0
            for block in range(n_blocks):
                rows = slice(first, ends[block])
                first = ends[block]
                if out[k, block] or not np.isfinite(logs[block]):
                    continue
                own = np.ascontiguousarray(weighted[rows])
                information = np.ascontiguousarray(W[rows, rows])
                gain = _gain(own, information, logs[block])
                if gain > most:
                    most, worst = gain, block
            if worst < 0:
                break
            first = 0 if worst == 0 else ends[worst - 1]
            out[k, worst] = True
            added[k] += logs[worst] + 0.5 * (ends[worst] - first) * np.log(2.0 * np.pi * far)
            for row in range(first, ends[worst]):
                y[k, row] = 0.0
                S[k, row, :] = 0.0
                S[k, :, row] = 0.0
                S[k, row, row] = far
    return out, added
