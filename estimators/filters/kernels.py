"""Compiled loops of the unscented filter: sigma points and moments.

Letters as in the textbook: x mean, P covariance, W weights, Q process noise, y innovation, S innovation covariance. For
about twenty states, plain loops are faster than calls of LAPACK.
"""

from __future__ import annotations

import numpy as np
from numba import njit

FASTMATH = {"contract", "reassoc"}
"""The compiler may fuse multiplications with additions, and reorder sums. NaN and infinity keep their meaning."""


@njit(cache=True, nogil=True)
def chol_lower(P):  # type: ignore[no-untyped-def]
    """Lower triangular matrix L (n, n) with `L L' = P`, and whether P is positive definite."""
    n = P.shape[0]
    L = np.zeros((n, n))
    for j in range(n):
        pivot = P[j, j]
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        if not pivot > 0.0:
            return L, False
        root = np.sqrt(pivot)
        L[j, j] = root
        for i in range(j + 1, n):
            entry = P[i, j]
            for k in range(j):
                entry -= L[i, k] * L[j, k]
            L[i, j] = entry / root
    return L, True


@njit(cache=True, nogil=True)
def is_finite(x, P):  # type: ignore[no-untyped-def]
    """Whether all numbers of a mean (n,) and a covariance (n, n) are finite."""
    return np.isfinite(x).all() and np.isfinite(P).all()


@njit(cache=True, nogil=True)
def is_gaussian(x, P, rounding):  # type: ignore[no-untyped-def]
    """Whether x (n,) is finite and P (n, n) is finite, positive definite and, up to `rounding`, symmetric."""
    n = P.shape[0]
    for i in range(n):
        if not np.isfinite(x[i]):
            return False
    largest, skew = 0.0, 0.0
    for i in range(n):
        for j in range(n):
            if not np.isfinite(P[i, j]):
                return False
            largest = max(largest, abs(P[i, j]))
            skew = max(skew, abs(P[i, j] - P[j, i]))
    return skew <= rounding * largest and chol_lower(P)[1]


@njit(cache=True, nogil=True)
def symmetric_points(x, P, scale):  # type: ignore[no-untyped-def]
    """Sigma points x and `x ± c` for each column c of `chol(scale P)`, (2n + 1, n); whether P is positive definite."""
    n = x.shape[0]
    L, definite = chol_lower(scale * P)
    points = np.empty((2 * n + 1, n))
    for i in range(n):
        points[0, i] = x[i]
        for k in range(n):
            points[1 + k, i] = x[i] + L[i, k]
            points[1 + n + k, i] = x[i] - L[i, k]
    return points, definite


@njit(cache=True, nogil=True, fastmath=FASTMATH)
def moments(points, Wm, Wc, Q):  # type: ignore[no-untyped-def]
    """Mean (n,) and exactly symmetric covariance (n, n) of points with weights Wm, Wc, plus noise covariance Q."""
    n_points, n = points.shape
    x = np.zeros(n)
    for k in range(n_points):
        for i in range(n):
            x[i] += Wm[k] * points[k, i]
    away = np.empty((n, n_points))
    for k in range(n_points):
        for i in range(n):
            away[i, k] = points[k, i] - x[i]
    P = np.empty((n, n))
    weighted = np.empty(n_points)
    for i in range(n):
        for k in range(n_points):
            weighted[k] = Wc[k] * away[i, k]
        for j in range(i + 1):
            entry = 0.0
            for k in range(n_points):
                entry += weighted[k] * away[j, k]
            entry += 0.5 * (Q[i, j] + Q[j, i])
            P[i, j] = entry
            P[j, i] = entry
    return x, P


@njit(cache=True, nogil=True)
def squared_mahalanobis(y, S):  # type: ignore[no-untyped-def]
    """Squared Mahalanobis distance y' S^-1 y [1] of an error y (n,) with the covariance S (n, n)."""
    return np.dot(y, np.linalg.inv(S) @ y)


@njit(cache=True, nogil=True)
def block_contributions(gain, S_inv, width):  # type: ignore[no-untyped-def]
    """Reduction of the target's variance by each block of `width` measurements, (m / width,).

    gain: Kalman gain G of the target, (n, m); S_inv: inverse of the innovation covariance S, (m, m)
    The reduction by block i is `trace(G_i ((S^-1)_ii)^-1 G_i')`.
    """
    traces = np.empty(len(S_inv) // width)
    for i in range(len(traces)):
        G = np.ascontiguousarray(gain[:, i * width : (i + 1) * width].T)
        block = np.ascontiguousarray(S_inv[i * width : (i + 1) * width, i * width : (i + 1) * width])
        traces[i] = np.sum(G * (np.linalg.inv(block) @ G))
    return traces


@njit(cache=True, nogil=True)
def nis_left(y, S_inv, width):  # type: ignore[no-untyped-def]
    """NIS that remains after the best common shift of all blocks, and smallest NIS after one block is omitted.

    y (m,), S_inv (m, m): innovation and inverse of its covariance; width: number of measurements in a block
    The best shift of blocks reduces the NIS by `w'H (H' S^-1 H)^-1 H'w`, with `w = S^-1 y`. H (m, width) is a unit
    matrix in the rows of every shifted block, else 0. Omitting a block reduces the NIS as much as its best shift.
    `np.linalg.inv` because numba compiles `np.linalg.solve` for seconds.
    """
    w, n = np.dot(S_inv, y), len(y) // width
    together, information, most = np.zeros(width), np.zeros((width, width)), 0.0
    for row in range(n * width):
        for column in range(n * width):
            information[row % width, column % width] += S_inv[row, column]
    for i in range(n):
        own = np.ascontiguousarray(w[i * width : (i + 1) * width])
        block = np.ascontiguousarray(S_inv[i * width : (i + 1) * width, i * width : (i + 1) * width])
        most = max(most, np.dot(own, np.linalg.inv(block) @ own))
        together += own
    nis = np.dot(y, w)
    return nis - np.dot(together, np.linalg.inv(information) @ together), nis - most


@njit(cache=True, nogil=True)
def association_costs(means, covs, z, R):  # type: ignore[no-untyped-def]
    """Cost (n, m) of assigning measurement j to expected mark i: -log of the measurement's density, up to a constant.

    means (n, dim), covs (n, dim, dim): expected marks; z (m, dim), R (m, dim, dim): measurements
    """
    n, dim = means.shape
    m = z.shape[0]
    costs = np.empty((n, m))
    w = np.empty(dim)
    for i in range(n):
        for j in range(m):
            C, definite = chol_lower(covs[i] + R[j])
            costs[i, j] = 0.0 if definite else np.inf
            for a in range(dim):
                if not definite:
                    break
                w[a] = z[j, a] - means[i, a]
                for b in range(a):
                    w[a] -= C[a, b] * w[b]
                w[a] /= C[a, a]
                costs[i, j] += 0.5 * w[a] * w[a] + np.log(C[a, a])
    return costs


@njit(cache=True, nogil=True)
def ambiguous_exchanges(costs, pairs, limit):  # type: ignore[no-untyped-def]
    """Whether any two marks can exchange names at an additional cost below `limit`.

    costs (n, n): cost of mark j on node i; the column of an absent mark is 0
    pairs (n, n): whether two marks may be exchanged
    """
    n = len(costs)
    for i in range(n):
        for j in range(i + 1, n):
            if not pairs[i, j] or (costs[i, i] == 0.0 and costs[j, j] == 0.0):
                continue
            if costs[j, i] + costs[i, j] - costs[i, i] - costs[j, j] < limit:
                return True
    return False
