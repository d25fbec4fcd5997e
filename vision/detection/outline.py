"""The outline of a mark, and its centre where a needle or a hand covers part of it.

A mark's centre of gravity is its centre only while all of it is seen. The visible part of its outline gives the centre
whatever covers the rest, less well for a shorter arc. Image axes: u right, v down, pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from vision.arrays import Floats
from vision.detection.settings import DETECTION, OutlineSettings

N_RAYS = 64
"""Directions in which the edge is searched, a discretisation: `correlation_px` accounts for correlated errors."""
RAYS = np.column_stack(
    [np.cos(2.0 * np.pi * np.arange(N_RAYS) / N_RAYS), np.sin(2.0 * np.pi * np.arange(N_RAYS) / N_RAYS)]
)
"""The directions as unit vectors, (N_RAYS, 2)."""
SETTLED = 1e-4
"""Convergence tolerance: after a step of less than this [sizes] the next is the last."""


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """The shape and size of a whole mark in a picture.

    shape_px: the mark is center + shape_px @ unit disc [px], shape (2, 2)
    size_sd: standard deviation of its size, as a share of it
    area_px: of the whole mark [px], from these
    even: it has one colour; otherwise, as for a ball with its shading, the rim is detected, not the colour
    """

    shape_px: Floats
    size_sd: float = 0.1
    even: bool = True
    area_px: float = field(init=False)

    def __post_init__(self) -> None:
        shape = np.array(self.shape_px, dtype=np.float64, order="C")
        if shape.shape != (2, 2) or not np.isfinite(shape).all() or np.linalg.det(shape) == 0.0:
            raise ValueError(f"outline shape_px: expected an invertible (2, 2), found {shape.tolist()}")
        if not self.size_sd > 0:
            raise ValueError(f"outline size_sd: expected more than 0, found {self.size_sd}")
        object.__setattr__(self, "shape_px", shape)
        object.__setattr__(self, "area_px", float(np.pi * abs(np.linalg.det(shape))))


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A mark fitted to the outline.

    center_px, cov_px2: the centre [px], (2,), and its covariance [px²], (2, 2)
    share: share of directions in which the mark's own edge is seen
    beyond: share of directions in which an edge lies outside it, as for a smeared or merged mark
    size: relative to that of the outline
    """

    center_px: Floats
    cov_px2: Floats
    share: float
    beyond: float
    size: float


def fit_outline(
    alpha: Floats, start_px: Floats, outline: Outline, settings: OutlineSettings = DETECTION.outline
) -> Fitted | None:
    """The mark whose edge is seen best; None if too little of it is seen.

    alpha: share of each pixel that the mark covers, 0 away from it, (h, w); its first pixel is (0, 0)
    start_px: a point inside the visible part, (2,)
    settings: `reach` is how far from there the edge may lie [sizes]; without an edge within it another mark follows
    """
    center, cov, share, beyond, size = _fitted(
        alpha, np.ascontiguousarray(start_px), outline.shape_px, outline.size_sd, settings.reach, settings.for_kernel()
    )
    return Fitted(center, cov, share, beyond, size) if share >= settings.min_share else None


@njit(cache=True, nogil=True, fastmath=True)
def _edges(alpha, start, shape, reach):  # type: ignore[no-untyped-def]
    """Outermost points in each direction where alpha falls through a half, relative to start in units of the mark."""
    height, width = alpha.shape
    step = 0.5 / np.sqrt(abs(shape[0, 0] * shape[1, 1] - shape[0, 1] * shape[1, 0]))
    edges, n_edges = np.empty((N_RAYS, 2)), 0
    for k in range(N_RAYS):
        x, y = RAYS[k, 0], RAYS[k, 1]
        along_u, along_v = shape[0, 0] * x + shape[0, 1] * y, shape[1, 0] * x + shape[1, 1] * y
        outer, t = 1.0, reach
        while t > 0.0:
            u, v = start[0] + t * along_u, start[1] + t * along_v
            here = 0.0
            if 0.0 <= u < width - 1 and 0.0 <= v < height - 1:
                i, j = int(v), int(u)
                a, b = v - i, u - j
                upper = (1.0 - b) * alpha[i, j] + b * alpha[i, j + 1]
                here = (1.0 - a) * upper + a * ((1.0 - b) * alpha[i + 1, j] + b * alpha[i + 1, j + 1])
            if here >= 0.5 and t == reach:
                break
            if here >= 0.5:
                between = t + step * (here - 0.5) / (here - outer)
                edges[n_edges, 0], edges[n_edges, 1] = between * x, between * y
                n_edges += 1
                break
            outer, t = here, t - step
    return edges, n_edges


@njit(cache=True, nogil=True, fastmath=True)
def _through(a, b, c):  # type: ignore[no-untyped-def]
    """Centre and radius of the circle through three points; radius 0 where there is none."""
    bx, by, cx, cy = b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]
    d = 2.0 * (bx * cy - by * cx)
    if abs(d) < 1e-9:
        return 0.0, 0.0, 0.0
    b2, c2 = bx * bx + by * by, cx * cx + cy * cy
    x, y = (cy * b2 - by * c2) / d, (bx * c2 - cx * b2) / d
    return a[0] + x, a[1] + y, np.hypot(x, y)


@njit(cache=True, nogil=True, fastmath=True)
def _candidate(edges, size_sd, near):  # type: ignore[no-untyped-def]
    """The circle (x, y, size) of size about 1 through three edges that has most edges on it and few beyond."""
    n = len(edges)
    best, fit = -np.inf, np.array([0.0, 0.0, 1.0])
    for spacing in (n // 10, n // 6, n // 4, n // 3):
        if spacing < 1:
            continue
        for i in range(n):
            x, y, size = _through(edges[i], edges[(i + spacing) % n], edges[(i + 2 * spacing) % n])
            if abs(size - 1.0) > 3.0 * size_sd:
                continue
            score = -0.5 * ((size - 1.0) / size_sd) ** 2
            inner, outer = max(size - near, 0.0) ** 2, (size + near) ** 2
            for k in range(n):
                squared = (edges[k, 0] - x) ** 2 + (edges[k, 1] - y) ** 2
                # An occluder moves a mark's edge inward, never outward.
                if squared > outer:
                    score -= 1.0
                elif squared > inner:
                    score += 1.0
            if score > best:
                best = score
                fit[0], fit[1], fit[2] = x, y, size
    return fit


@njit(cache=True, nogil=True, fastmath=True)
def _refined(edges, start, size_sd, scale, settings):  # type: ignore[no-untyped-def]
    """The circle near this one by Tukey's robust least squares.

    Returns (x, y, size), its normal matrix (3, 3), the variance of an edge and of waves around the outline, and the
    shares of directions with an edge on it and beyond it.
    """
    n = len(edges)
    fit, normal = start.copy(), np.zeros((3, 3))
    near, floor, highest_wave = settings[0] / scale, (settings[3] / scale) ** 2, int(settings[2])
    variance, n_on, n_beyond = floor, 0.0, 0
    waves = np.zeros((highest_wave + 1, 2))
    settled = False
    for turn in range(6):
        last = settled or turn == 5
        # The prior on the size, in units of an edge's variance
        weight = variance / size_sd**2
        a00 = a01 = a02 = a11 = a12 = 0.0
        a22, g0, g1, g2 = weight, 0.0, 0.0, weight * (1.0 - fit[2])
        squares = weights2 = n_on = 0.0
        n_beyond = 0
        limit = max(near, 4.7 * np.sqrt(variance))
        for k in range(n):
            x, y = edges[k, 0] - fit[0], edges[k, 1] - fit[1]
            length = max(np.sqrt(x * x + y * y), 1e-9)
            error = length - fit[2]
            n_beyond += error > limit
            if abs(error) >= limit:
                continue
            # Tukey's biweight; the error falls by (x, y) / length for a step of the centre, by 1 for a step of the size
            w = (1.0 - (error / limit) ** 2) ** 2
            x, y = x / length, y / length
            a00 += w * x * x
            a01 += w * x * y
            a02 += w * x
            a11 += w * y * y
            a12 += w * y
            a22 += w
            g0 += w * error * x
            g1 += w * error * y
            g2 += w * error
            squares += w * error * error
            weights2 += w * w
            n_on += w
            if not last:
                continue
            # cos and sin of k times the angle, by recurrence
            turned_x, turned_y = x, y
            for k_wave in range(2, highest_wave + 1):
                turned_x, turned_y = turned_x * x - turned_y * y, turned_x * y + turned_y * x
                waves[k_wave, 0] += w * error * turned_x
                waves[k_wave, 1] += w * error * turned_y
        normal = np.array([[a00, a01, a02], [a01, a11, a12], [a02, a12, a22]])
        step = np.array([g0, g1, g2])
        if n_on < 3.0 or abs(np.linalg.det(normal)) < 1e-9:
            return fit, np.eye(3), variance, 0.0, 0.0, 0.0
        step = np.linalg.inv(normal) @ step
        fit += step
        narrower, variance = variance, max(squares / n_on, floor)
        if last:
            break
        settled = abs(variance - narrower) < 0.01 * variance and np.abs(step).max() < SETTLED
    # A shift of the centre is one wave around the outline. A circle has no two to seven waves: their residual measures
    # how strong one wave by noise, highlights and compression is.
    power = (waves**2).sum() / (highest_wave - 1) / weights2
    return fit, normal, variance, power, n_on / N_RAYS, n_beyond / N_RAYS


@njit(cache=True, nogil=True)
def _fitted(alpha, start, shape, size_sd, reach, settings):  # type: ignore[no-untyped-def]
    """Centre, covariance, share, beyond, size: fit of the whole mark, or else the best circle through three edges."""
    near_px, correlation_px, _, _, min_share, whole_share = settings
    edges, n_edges = _edges(alpha, start, shape, reach)
    if n_edges < min_share * N_RAYS:
        return start, np.eye(2), 0.0, 0.0, 1.0
    edges = edges[:n_edges]
    scale = np.sqrt(abs(np.linalg.det(shape)))
    middle = np.array([edges[:, 0].mean(), edges[:, 1].mean(), 1.0])
    fit, normal, variance, power, share, beyond = _refined(edges, middle, size_sd, scale, settings)
    if share <= whole_share:
        start_at = _candidate(edges, size_sd, near_px / scale)
        fit, normal, variance, power, share, beyond = _refined(edges, start_at, size_sd, scale, settings)
    if share == 0.0:
        return start, np.eye(2), share, beyond, 1.0
    # Errors of neighbouring edges are correlated; the corners of a covered part add a small bias, too.
    together = max(1.0, correlation_px * N_RAYS / (2.0 * np.pi * scale * fit[2])) / share
    inside = np.ascontiguousarray(np.linalg.inv(normal)[:2, :2])
    return (
        start + shape @ fit[:2],
        max(variance * together, power / share) * shape @ inside @ shape.T,
        share,
        beyond,
        fit[2],
    )
