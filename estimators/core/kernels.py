"""Compiled loops of the filter: covariances after a transition, cross-validation of marks, removal of outliers.

Kernels that call each other are in one file, because numba's disk cache ignores changes in other files.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def move(P, rows, fading, moved):  # type: ignore[no-untyped-def]
    """Write `T P T'` into `moved`, (n, n). T has `rows` (r, c) at the top left, the diagonal `fading` below, else 0."""
    r, c = rows.shape
    half = rows @ P[:c]
    corner = np.ascontiguousarray(half[:, :c]) @ rows.T
    for i in range(len(P)):
        for j in range(r):
            moved[i, j] = 0.5 * (corner[i, j] + corner[j, i]) if i < r else moved[j, i]
        for j in range(r, len(P)):
            moved[i, j] = half[i, j] * fading[j] if i < r else P[i, j] * (fading[i] * fading[j])


@njit(cache=True, nogil=True)
def mixed_rows(modes, shares, left, apart, covs, variances, noises):  # type: ignore[no-untyped-def]
    """Product `H P`, (k, m, n), for each of k modes. P is the covariance of a mixture of l Gaussians, plus noise.

    modes (any,): modes to compute; for all other modes, the product is zero
    shares (l, k): weights of the Gaussians in the mixture of each mode
    covs (l, m, n): H times the covariance of each Gaussian
    apart (l, k, n): (mean of a Gaussian - mean of the mixture) * sqrt(weight)
    left (l, k, m): H times `apart`
    variances (k, n_sources): noise variances
    noises (n_sources, any, any): H times the noise covariance at variance 1
    """
    n_mixed, m, n = covs.shape
    found = np.zeros((shares.shape[1], m, n))
    for i in range(m):
        for k in modes:
            row = found[k, i]
            for one in range(n_mixed):
                share, by = shares[one, k], left[one, k, i]
                if share != 0.0:
                    for j in range(n):
                        row[j] += share * covs[one, i, j] + by * apart[one, k, j]
            for source in range(len(noises) if i < noises.shape[1] else 0):
                variance = variances[k, source]
                for j in range(noises.shape[2]):
                    row[j] += variance * noises[source, i, j]
    return found


@njit(cache=True, nogil=True)
def _whitened(A, b):  # type: ignore[no-untyped-def]
    """Lower Cholesky factor L of A (n, n), and L^-1 b, (n,). Raises LinAlgError if A is not positive definite."""
    L, white = np.zeros(A.shape), b.copy()
    for row in range(len(b)):
        for column in range(row + 1):
            left = A[row, column]
            for k in range(column):
                left -= L[row, k] * L[column, k]
            if column == row and not left > 0.0:
                raise np.linalg.LinAlgError("expected a positive definite matrix, found another")
            L[row, column] = np.sqrt(left) if column == row else left / L[column, column]
        white[row] = (b[row] - L[row, :row] @ white[:row]) / L[row, row]
    return L, white


@njit(cache=True, nogil=True)
def withheld_log_likelihoods(roots, innovation, rows, ends, own):  # type: ignore[no-untyped-def]
    """For each innovation covariance S, sum of the log likelihoods of marks that are predicted from other marks, (k,).

    Each mark has a group g of rows: its own rows, and the rows of marks that do not predict it. The rows outside g
    predict `y_g` with the error `W_gg^-1 (W y)_g`, where `W = S^-1`. The covariance of this error is `W_gg^-1`.
    roots (k, m, m): inverses of the lower Cholesky factors of S
    rows (any,): rows of all groups, group by group; each group begins with the rows of its mark
    ends (n_groups,): end of each group in `rows`
    own (n_groups,): number of rows of the mark in each group
    """
    totals = np.zeros(len(roots))
    for k in range(len(roots)):
        W = roots[k].T @ roots[k]
        weighted, start = W @ innovation, 0
        for group in range(len(ends)):
            g = rows[start : ends[group]][::-1]
            root, white = _whitened(W[g][:, g], weighted[g])
            for row in range(len(g) - own[group], len(g)):
                totals[k] += np.log(root[row, row]) - 0.5 * white[row] ** 2
            start = ends[group]
    return totals


@njit(cache=True, nogil=True)
def without_outliers(y, S, roots, ends, logs, far):  # type: ignore[no-untyped-def]
    """Whether each block is an outlier in each hypothesis, (k, n_blocks); sum of the outliers' log densities, (k,).

    y (k, m), S (k, m, m): innovations and covariances, changed in place: an outlier gets innovation 0, variance `far`
    roots (k, m, m): inverses of the lower Cholesky factors of S
    ends (n_blocks,): end of each block's rows
    logs (n_blocks,): log density of each block if the block is an outlier

    Each pass removes the block with the largest gain, until no gain is positive. The gain is the log density of a block
    as an outlier, minus its log density given the other blocks. The other blocks predict block g with the error
    `W_gg^-1 (W y)_g`, where `W = S^-1`. The covariance of this error is `W_gg^-1`.
    """
    n_blocks = len(ends)
    out, added = np.zeros((len(y), n_blocks), dtype=np.bool_), np.zeros(len(y))
    for k in range(len(y)):
        W = roots[k].T @ roots[k]
        for _ in range(n_blocks):
            weighted = W @ y[k]
            most, worst, own, first = 0.0, -1, slice(0, 0), 0
            for block in range(n_blocks):
                rows = slice(first, ends[block])
                first = ends[block]
                if out[k, block] or not np.isfinite(logs[block]):
                    continue
                root, white = _whitened(W[rows, rows], weighted[rows])
                gain = logs[block] + (0.5 * white**2 - np.log(np.diag(root) / np.sqrt(2.0 * np.pi))).sum()
                if gain > most:
                    most, worst, own = gain, block, rows
            if worst < 0:
                break
            out[k, worst] = True
            added[k] += logs[worst] + 0.5 * (own.stop - own.start) * np.log(2.0 * np.pi * far)
            y[k, own], S[k, own], S[k, :, own] = 0.0, 0.0, 0.0
            for row in range(own.start, own.stop):
                S[k, row, row] = far
            W = np.ascontiguousarray(np.linalg.inv(S[k]))
    return out, added
