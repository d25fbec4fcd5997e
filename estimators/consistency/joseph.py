"""Kalman update in Joseph's form, compiled.

Letters as in the textbook: x mean, P covariance, z measurement, H measurement matrix, R measurement noise covariance,
y innovation, S innovation covariance, K gain.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from estimators.filters.kernels import chol_lower


@njit(cache=True, nogil=True)
def joseph_update(x, P, z, H, R):  # type: ignore[no-untyped-def]
    """Kalman update; returns x, P, y, S, K, the NIS y' S^-1 y, log det S, and whether S was positive definite."""
    y, PH = z - H @ x, P @ H.T
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
        for i in range(n):  # K S = P H', by two triangular solves per row
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
