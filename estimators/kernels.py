"""Compiled sums of the unscented filter: sigma points, their moments, the Joseph update.

Letters as in the textbook: x mean, P covariance, W weights, Q process noise, z measurement, H its matrix, R its noise,
y innovation, S its covariance, K gain. Plain loops: at some twenty states they beat a call into LAPACK.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def chol_lower(P):  # type: ignore[no-untyped-def]
    """Lower L with L L' = P, (n, n), and whether P was positive definite."""
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
def symmetric_points(x, P, scale):  # type: ignore[no-untyped-def]
    """x, then x plus and x minus the columns of chol(scale P), (2n + 1, n), and whether P was positive definite."""
    n = x.shape[0]
    L, definite = chol_lower(scale * P)
    points = np.empty((2 * n + 1, n))
    for i in range(n):
        points[0, i] = x[i]
        for k in range(n):
            points[1 + k, i] = x[i] + L[i, k]
            points[1 + n + k, i] = x[i] - L[i, k]
    return points, definite


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def moments(points, Wm, Wc, Q):  # type: ignore[no-untyped-def]
    """Mean and covariance of weighted points, noise added: (n,), (n, n) symmetric to the last bit."""
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
def joseph_update(x, P, z, H, R):  # type: ignore[no-untyped-def]
    """Kalman update in Joseph's form: x, P, y, S, K, nis y' S^-1 y, log det S, and whether S was positive definite."""
    y = z - H @ x
    PH = P @ H.T
    S = H @ PH + R
    S = 0.5 * (S + S.T)
    C, definite = chol_lower(S)
    n, m = PH.shape
    K = np.zeros((n, m))
    nis, log_det = 0.0, 0.0
    if definite:
        w = np.empty(m)
        for a in range(m):
            w[a] = y[a]
            for b in range(a):
                w[a] -= C[a, b] * w[b]
            w[a] /= C[a, a]
            nis += w[a] * w[a]
            log_det += 2.0 * np.log(C[a, a])
        for i in range(n):  # K S = P H', by two triangular solves a row
            for a in range(m):
                entry = PH[i, a]
                for b in range(a):
                    entry -= C[a, b] * K[i, b]
                K[i, a] = entry / C[a, a]
            for a in range(m - 1, -1, -1):
                entry = K[i, a]
                for b in range(a + 1, m):
                    entry -= C[b, a] * K[i, b]
                K[i, a] = entry / C[a, a]
    keep = np.eye(n) - K @ H
    updated = keep @ P @ keep.T + K @ R @ K.T
    return x + K @ y, 0.5 * (updated + updated.T), y, S, K, nis, log_det, definite
