"""Compiled integrals of a Gaussian over a lesion, and insertions towards a predicted path of the target.

A linear map turns the lesion into the unit ball. In the ball, the notch has the length `l`. Its middle has the
coordinate `a` along the needle and `y` across the needle. At least the length `L` of the notch lies in the ball if
`|y|² <= 1 - L²/4` and `|a| <= h + l/2 - L` with `h = sqrt(1 - |y|²)`. For a point, `l = L = 0`. The integral over `a`
is a difference of error functions. The integral over `y` is a Gauss-Legendre sum over an angle, in which `h` is smooth.
"""

from __future__ import annotations

from math import asin, cos, erf, exp, inf, pi, sin, sqrt

import numpy as np
from numba import njit

SIZES = (12, 20, 32, 64)
"""Numbers of Gauss-Legendre nodes. If the integrand changes more over the interval, `_rule` selects more nodes."""

FIRST = np.cumsum((0, *SIZES))
NODES = np.concatenate([np.polynomial.legendre.leggauss(n)[0] for n in SIZES])
WEIGHTS = np.concatenate([np.polynomial.legendre.leggauss(n)[1] for n in SIZES])

WIDE = 6.5
"""Distance from the mean, in standard deviations, beyond which a Gaussian is neglected: a probability of 8e-11."""

STEEP, PARTS = 60.0, 15
"""An interval of more than STEEP standard deviations is split into up to PARTS + 1 parts."""


@njit(cache=True, nogil=True)
def _rule(span):  # type: ignore[no-untyped-def]
    """Index of the quadrature rule for an interval of `span` standard deviations."""
    if span < 4.0:
        return 0
    if span < 9.0:
        return 1
    return 2 if span < 20.0 else 3


@njit(cache=True, nogil=True)
def _slab(k, mean, sd):  # type: ignore[no-untyped-def]
    """Probability that |a| <= k for a normal variable a."""
    if sd <= 0.0:
        return 1.0 if abs(mean) <= k else 0.0
    scale = 1.0 / (sd * sqrt(2.0))
    return 0.5 * (erf((k - mean) * scale) + erf((k + mean) * scale))


@njit(cache=True, nogil=True)
def _disc(radius, edge, extra, m, s, a, slope, tau):  # type: ignore[no-untyped-def]
    """Probability that the normal variables y and b satisfy `|y| <= edge` and `|b| <= sqrt(radius² - y²) + extra`.

    Across the needle, y has mean m and sd s. Along the needle, b given y has mean `a + slope (y - m)` and sd tau.
    """
    low, high = max(-edge, m - WIDE * s), min(edge, m + WIDE * s)
    if s <= 0.0:
        return _slab(sqrt(radius * radius - m * m) + extra, a, tau) if abs(m) <= edge else 0.0
    if low >= high:
        return 0.0
    start, end = asin(max(low / radius, -1.0)), asin(min(high / radius, 1.0))
    rise = 1.0 if low * high < 0.0 else max(cos(start), cos(end))
    changes = radius * (rise - min(cos(start), cos(end))) + abs(slope) * (high - low)
    span = (high - low) / s
    if tau * span < changes:
        span = min(changes / tau, STEEP * PARTS) if tau > 0.0 else STEEP * PARTS
    parts = 1 + int(span / STEEP)
    rule = _rule(span)
    half = 0.5 * (end - start) / parts
    total = 0.0
    for part in range(parts):
        middle = start + (2 * part + 1) * half
        for i in range(FIRST[rule], FIRST[rule + 1]):
            angle = middle + half * NODES[i]
            y, h = radius * sin(angle), radius * cos(angle)
            z = (y - m) / s
            total += WEIGHTS[i] * h * exp(-0.5 * z * z) * _slab(h + extra, a + slope * (y - m), tau)
    return total * half / (s * sqrt(2.0 * pi))


@njit(cache=True, nogil=True)
def _solid(edge, extra, m, s, a, slope, tau):  # type: ignore[no-untyped-def]
    """Probability of `_disc` in space: y has two coordinates across the needle, and m, s, slope have two entries."""
    reach = WIDE * s[0]
    low, high = max(-edge, m[0] - reach), min(edge, m[0] + reach)
    if s[0] <= 0.0:
        if abs(m[0]) > edge:
            return 0.0
        left = sqrt(max(edge * edge - m[0] * m[0], 0.0))
        return _disc(sqrt(max(1.0 - m[0] * m[0], 0.0)), left, extra, m[1], s[1], a, slope[1], tau)
    if low >= high:
        return 0.0
    start, end = asin(max(low / edge, -1.0)), asin(min(high / edge, 1.0))
    half, middle = 0.5 * (end - start), 0.5 * (end + start)
    rise = 1.0 if low * high < 0.0 else max(cos(start), cos(end))
    least = max(min(s[1], tau), 1e-9)
    changes = edge * (rise - min(cos(start), cos(end))) + abs(slope[0]) * (high - low)
    rule = _rule(max((high - low) / s[0], changes / least))
    total = 0.0
    for i in range(FIRST[rule], FIRST[rule + 1]):
        angle = middle + half * NODES[i]
        y, left = edge * sin(angle), edge * cos(angle)
        z = (y - m[0]) / s[0]
        radius = sqrt(max(1.0 - y * y, 1e-300))
        inner = _disc(radius, min(left, radius), extra, m[1], s[1], a + slope[0] * (y - m[0]), slope[1], tau)
        total += WEIGHTS[i] * left * exp(-0.5 * z * z) * inner
    return total * half / (s[0] * sqrt(2.0 * pi))


@njit(cache=True, nogil=True)
def rotation_of(C, n):  # type: ignore[no-untyped-def]
    """Rotation V that makes V' C V diagonal in the leading n x n block of C, by Jacobi sweeps."""
    A, V = C.copy(), np.eye(C.shape[0])
    for _ in range(20):
        off_diagonal = size = 0.0
        for p in range(n):
            size += abs(A[p, p])
            for q in range(p + 1, n):
                off_diagonal += abs(A[p, q])
        if off_diagonal <= 1e-15 * size:
            break
        for p in range(n):
            for q in range(p + 1, n):
                if A[p, q] == 0.0:
                    continue
                ratio = 0.5 * (A[q, q] - A[p, p]) / A[p, q]
                t = 1.0 / (abs(ratio) + sqrt(ratio * ratio + 1.0))
                if ratio < 0.0:
                    t = -t
                c = 1.0 / sqrt(t * t + 1.0)
                s = t * c
                for k in range(A.shape[0]):
                    x, y = A[k, p], A[k, q]
                    A[k, p], A[k, q] = c * x - s * y, s * x + c * y
                for k in range(A.shape[0]):
                    x, y = A[p, k], A[q, k]
                    A[p, k], A[q, k] = c * x - s * y, s * x + c * y
                    x, y = V[k, p], V[k, q]
                    V[k, p], V[k, q] = c * x - s * y, s * x + c * y
    return A, V


@njit(cache=True, nogil=True)
def _frame(w):  # type: ignore[no-untyped-def]
    """Orthonormal basis, with its vectors as columns (d, d); the last one is the unit vector w (d,)."""
    d = w.shape[0]
    F = np.zeros((d, d))
    if d == 2:
        F[0, 0], F[1, 0] = -w[1], w[0]
    else:
        k = int(np.argmin(np.abs(w)))
        size = sqrt(1.0 - w[k] * w[k])
        for i in range(3):
            F[i, 0] = ((1.0 if i == k else 0.0) - w[k] * w[i]) / size
        F[0, 1] = w[1] * F[2, 0] - w[2] * F[1, 0]
        F[1, 1] = w[2] * F[0, 0] - w[0] * F[2, 0]
        F[2, 1] = w[0] * F[1, 0] - w[1] * F[0, 0]
    for i in range(d):
        F[i, d - 1] = w[i]
    return F


@njit(cache=True, nogil=True)
def _moved(F, m, C):  # type: ignore[no-untyped-def]
    """F' m and F' C F by loops, which are faster than LAPACK for three coordinates."""
    d = m.shape[0]
    x, P, half = np.zeros(d), np.zeros((d, d)), np.zeros((d, d))
    for i in range(d):
        for k in range(d):
            x[i] += F[k, i] * m[k]
            for j in range(d):
                half[i, j] += F[k, i] * C[k, j]
    for i in range(d):
        for j in range(d):
            for k in range(d):
                P[i, j] += half[i, k] * F[k, j]
    return x, P


@njit(cache=True, nogil=True)
def hit(offset, cov, axis, to_ball, length, core):  # type: ignore[no-untyped-def]
    """Probability that at least the length `core` of the notch lies in the lesion. A notch of `length` 0 is a point.

    offset (d,), cov (d, d): mean and covariance of the notch's middle relative to the target
    axis (d,): unit vector along the needle; to_ball (d, d): linear map from the lesion to the unit ball
    """
    d = offset.shape[0]
    m, C = _moved(to_ball.T, offset, cov)
    if length <= 0.0:
        A, V = rotation_of(C, d)
        F = np.zeros((d, d))
        for j in range(d):  # columns in the order of their variances; numba compiles `np.argsort` for seconds
            place = 0
            for k in range(d):
                place += A[k, k] < A[j, j] or (k < j and A[k, k] == A[j, j])
            for i in range(d):
                F[i, place] = V[i, j]
        scale = 0.0
    else:
        w, size = np.zeros(d), 0.0
        for i in range(d):
            for k in range(d):
                w[i] += to_ball[i, k] * axis[k]
            size += w[i] * w[i]
        scale = sqrt(size)
        F = _frame(w / scale)
    x, P = _moved(F, m, C)
    if length > 0.0 and d == 3:
        _, V = rotation_of(P, d - 1)
        x, P = _moved(V, x, P)
    extra = scale * (0.5 * length - core)
    edge = 1.0 - (0.5 * scale * core) ** 2
    if edge <= 0.0:
        return 0.0
    edge = sqrt(edge)
    s, slope = np.zeros(d - 1), np.zeros(d - 1)
    left = P[d - 1, d - 1]
    for i in range(d - 1):
        s[i] = sqrt(max(P[i, i], 0.0))
        if length > 0.0 and P[i, i] > 0.0:
            slope[i] = P[d - 1, i] / P[i, i]
            left -= slope[i] * P[d - 1, i]
    tau = sqrt(max(left, 0.0))
    if d == 2:
        return _disc(1.0, edge, extra, x[0], s[0], x[1], slope[0], tau)
    return _solid(edge, extra, x, s, x[2], slope, tau)


@njit(cache=True, nogil=True)
def hit_each(offsets, covs, axis, to_ball, length, core):  # type: ignore[no-untyped-def]
    """Probabilities of `hit`, (k,), for k offsets (k, d) and covariances (k, d, d)."""
    found = np.empty(offsets.shape[0])
    for i in range(found.shape[0]):
        found[i] = hit(offsets[i], covs[i], axis, to_ball, length, core)
    return found


@njit(cache=True, nogil=True)
def ball_hits(offsets, covs, radius):  # type: ignore[no-untyped-def]
    """Probability that each point lies in a ball, (k,); offsets (k, d), covs (k, d, d): relative to the centre."""
    d = offsets.shape[1]
    return hit_each(offsets, covs, np.zeros(d), np.eye(d) / radius, 0.0, 0.0)


@njit(cache=True, nogil=True)
def _mean_at(times, means, j, t):  # type: ignore[no-untyped-def]
    """Mean of the path at a time t in interval j, by cubic interpolation with slopes from the adjacent intervals."""
    n, d = means.shape
    step = times[j + 1] - times[j]
    u = (t - times[j]) / step
    found = np.empty(d)
    for i in range(d):
        rise = (means[j + 1, i] - means[j, i]) / step
        first, last = rise, rise
        if j > 0:
            before = times[j] - times[j - 1]
            slope = (means[j, i] - means[j - 1, i]) / before
            first = (slope * step + rise * before) / (step + before)
        if j < n - 2:
            after = times[j + 2] - times[j + 1]
            slope = (means[j + 2, i] - means[j + 1, i]) / after
            last = (slope * step + rise * after) / (step + after)
        found[i] = (
            (1.0 + 2.0 * u) * (1.0 - u) ** 2 * means[j, i]
            + u * (1.0 - u) ** 2 * step * first
            + u * u * (3.0 - 2.0 * u) * means[j + 1, i]
            + u * u * (u - 1.0) * step * last
        )
    return found


@njit(cache=True, nogil=True)
def _wanted(mean, entry, axis, reach, aimed):  # type: ignore[no-untyped-def]
    """Depth of the tip at which the notch is level with the target; aimed: whether the needle is turned towards it."""
    along, squared = 0.0, 0.0
    for i in range(entry.shape[0]):
        along += axis[i] * (mean[i] - entry[i])
        squared += (mean[i] - entry[i]) ** 2
    return (sqrt(squared) if aimed else along) + reach


@njit(cache=True, nogil=True)
def _arrival(start, path, needle, aimed):  # type: ignore[no-untyped-def]
    """Index of the path's time interval in which the needle arrives, and time of arrival; (-1, inf) if it does not."""
    times, means = path[0], path[1]
    n, j = times.shape[0], 0
    entry, axis, speed, depth, reach = needle
    while j < n - 2 and times[j + 1] < start:
        j += 1
    if depth >= _wanted(_mean_at(times, means, j, start), entry, axis, reach, aimed):
        return j, start
    while j < n - 1:
        tip = depth + speed * (times[j + 1] - start)
        if tip >= _wanted(means[j + 1], entry, axis, reach, aimed):
            low, high = max(start, times[j]), times[j + 1]
            for _ in range(40):
                middle = 0.5 * (low + high)
                there = _wanted(_mean_at(times, means, j, middle), entry, axis, reach, aimed)
                if depth + speed * (middle - start) >= there:
                    high = middle
                else:
                    low = middle
                if high - low < 1e-7:
                    break
            return j, high
        j += 1
    return -1, inf


@njit(cache=True, nogil=True)
def insert_each(starts, path, needle, spread, to_ball, length, core, aimed):  # type: ignore[no-untyped-def]
    """Results of insertions that begin at the times `starts`, (k,).

    Returns, for each insertion, arrival time (k,), depth of the tip (k,), position of the target at arrival (k, d) and
    hit probability (k,). If a needle does not arrive, its arrival time is inf, and its hit probability is 0.

    path: times (n,) and means (n, d) of the target, then the c parts of its mixture: weights (n, c), means relative to
        the mean of the mixture (n, c, d), covs (n, c, d, d)
    needle: entry (d,), axis (d,), speed, present depth, distance from the tip back to the notch's middle
    spread: see `Needle.spread`; aimed: whether the needle is first turned about its entry towards the future target
    """
    times, means, weights, aside, covs = path
    entry, axis, _speed, depth, reach = needle
    k, d = starts.shape[0], means.shape[1]
    arrivals, depths, targets, p = np.full(k, inf), np.full(k, inf), np.full((k, d), inf), np.zeros(k)
    for i in range(k):
        j, at = _arrival(starts[i], path, needle, aimed)
        if j < 0:
            continue
        mean = _mean_at(times, means, j, at)
        wanted = _wanted(mean, entry, axis, reach, aimed)
        way = (mean - entry) / max(wanted - reach, 1e-12) if aimed else axis
        deep = max(wanted, depth)
        share = (at - times[j]) / (times[j + 1] - times[j])
        cov, offset = np.empty((d, d)), np.empty(d)
        for c in range(weights.shape[1]):
            weight = (1.0 - share) * weights[j, c] + share * weights[j + 1, c]
            if weight == 0.0:
                continue
            for a in range(d):
                offset[a] = entry[a] + (deep - reach) * way[a] - mean[a]
                offset[a] -= (1.0 - share) * aside[j, c, a] + share * aside[j + 1, c, a]
                for b in range(d):
                    cov[a, b] = (1.0 - share) * covs[j, c, a, b] + share * covs[j + 1, c, a, b]
                    cov[a, b] += spread[0] + spread[1] * deep * deep if a == b else 0.0
                    cov[a, b] -= spread[1] * deep * deep * way[a] * way[b]
            p[i] += weight * hit(offset, cov, way, to_ball, length, core)
        arrivals[i], depths[i] = at, wanted
        for a in range(d):
            targets[i, a] = mean[a]
    return arrivals, depths, targets, p
