"""Compiled step backwards of the smoother, over all pairs of a mode before and a mode after.

Plain loops: at some twenty states they beat calls into LAPACK, and wait for nobody's threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from estimators.filters.kernels import chol_lower

FASTMATH = {"contract", "reassoc"}
"""Reorderings that the compiler may make in sums; NaN and infinity keep their meaning."""


@njit(cache=True, nogil=True)
def roots_each(covs):  # type: ignore[no-untyped-def]
    """Lower triangular roots of each covariance, (k, n, n), and whether all were positive definite."""
    roots, all_definite = np.empty_like(covs), True
    for j in range(len(covs)):
        roots[j], definite = chol_lower(covs[j])
        all_definite &= definite
    return roots, all_definite


@njit(cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def forward_solved(L, B):  # type: ignore[no-untyped-def]
    """L^-1 B of a lower triangular L (n, n): (n, m)."""
    n, m = B.shape
    X = np.empty((n, m))
    for i in range(n):
        for c in range(m):
            X[i, c] = B[i, c]
        for a in range(i):
            factor = L[i, a]
            for c in range(m):
                X[i, c] -= factor * X[a, c]
        for c in range(m):
            X[i, c] /= L[i, i]
    return X


@njit(cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def gains(roots, predicted_covs, F, after_covs):  # type: ignore[no-untyped-def]
    """Of each mode the smoother's gain G = (F L)' P^-1, by the root L of its mix, and G (P - P_after) G': (k, n, n).

    Also whether all P, predicted_covs, were positive definite.
    """
    k, n, _ = roots.shape
    G, M = np.empty((k, n, n)), np.empty((k, n, n))
    for j in range(k):
        C, definite = chol_lower(predicted_covs[j])
        if not definite:
            return G, M, False
        across = np.zeros((n, n))
        for a in range(n):
            for b in range(n):
                factor = F[j, a, b]
                for c in range(b + 1):
                    across[a, c] += factor * roots[j, b, c]
        solved = forward_solved(C, across)
        for a in range(n - 1, -1, -1):  # back by the transpose
            for c in range(n):
                solved[a, c] /= C[a, a]
            for b in range(a):
                factor = C[a, b]
                for c in range(n):
                    solved[b, c] -= factor * solved[a, c]
        taken = np.zeros((n, n))
        for a in range(n):
            for b in range(n):
                factor = predicted_covs[j, a, b] - after_covs[j, a, b]
                for c in range(n):
                    taken[a, c] += factor * solved[b, c]
        M[j] = 0.0
        for b in range(n):
            for a in range(n):
                factor = solved[b, a]
                G[j, a, b] = factor
                for c in range(n):
                    M[j, a, c] += factor * taken[b, c]
    return G, M, True


@njit(cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def met(means, roots, mix_means, mix_roots, N, pull):  # type: ignore[no-untyped-def]
    """Each mode i before, met by the likelihood of each mode j after: log weights (k, k), means, covariances.

    means (k, n), roots (k, n, n): of the modes before; mix_means, mix_roots: of the mixes that go on in each mode
    N (k, n, n), pull (k, n): likelihood exp(y' pull - y' N y / 2), y the state from the mix's mean by its root
    Also whether all 1 + T' N T were positive definite, T the root of mode i by that of mix j.
    """
    k, n = means.shape
    logs, found_means, covs = np.empty((k, k)), np.empty((k, k, n)), np.empty((k, k, n, n))
    u, Nu, slope, step = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for j in range(k):
        for i in range(k):
            T = forward_solved(mix_roots[j], roots[i])
            for a in range(n):
                u[a] = means[i, a] - mix_means[j, a]
                for b in range(a):
                    u[a] -= mix_roots[j, a, b] * u[b]
                u[a] /= mix_roots[j, a, a]
            logs[i, j] = 0.0
            for a in range(n):
                Nu[a] = 0.0
                for b in range(n):
                    Nu[a] += N[j, a, b] * u[b]
                logs[i, j] += u[a] * (pull[j, a] - 0.5 * Nu[a])
            NT, S = np.zeros((n, n)), np.eye(n)
            slope[:] = 0.0
            for a in range(n):
                for b in range(n):
                    factor = N[j, a, b]
                    for c in range(b + 1):  # T is lower triangular
                        NT[a, c] += factor * T[b, c]
                for c in range(a + 1):
                    slope[c] += T[a, c] * (pull[j, a] - Nu[a])
            for b in range(n):
                for a in range(b + 1):
                    factor = T[b, a]
                    for c in range(a + 1):
                        S[a, c] += factor * NT[b, c]
            C, definite = chol_lower(S)
            if not definite:
                return logs, found_means, covs, False
            left = forward_solved(C, roots[i].T)
            for a in range(n):
                step[a] = slope[a]
                for b in range(a):
                    step[a] -= C[a, b] * step[b]
                step[a] /= C[a, a]
                logs[i, j] += 0.5 * step[a] * step[a] - np.log(C[a, a])
            covs[i, j] = 0.0
            found_means[i, j] = means[i]
            for b in range(n):
                for a in range(n):
                    factor = left[b, a]
                    found_means[i, j, a] += factor * step[b]
                    for c in range(a + 1):
                        covs[i, j, a, c] += factor * left[b, c]
            for a in range(n):
                for c in range(a):
                    covs[i, j, c, a] = covs[i, j, a, c]
    return logs, found_means, covs, True
