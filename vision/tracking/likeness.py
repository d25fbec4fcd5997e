"""Compiled comparison of a picture with a mark's appearance, position by position.

frame: (height, width, 3) uint8; box: compared positions, from (u0, v0) up to but not including (u1, v1) [px]
inside, ring: pixels of the mark and of the ring around the mark, relative to the mark's centre, each (n, 2)
colors: colours of the pixels `inside`, (n, 3); core, behind: median colours of `inside` and `ring`, each (3,)
settings: from `AppearanceSettings.for_kernel`
"""

from __future__ import annotations

import numpy as np
from numba import njit

N_FITS = 2
"""Number of iterations in the fit of a colour. More iterations do not change the result."""


@njit(cache=True, nogil=True)
def pixels_of(inverse, half, margin, ring_px):  # type: ignore[no-untyped-def]
    """Pixels inside a mark, and pixels of the ring around it, both relative to the mark's centre, each (n, 2).

    inverse: inverse of the mark's shape, (2, 2); half: distance from the centre to the ring's outer edge [px]
    margin, ring_px: see `AppearanceSettings`
    """
    places = np.empty((2, (2 * half + 1) ** 2, 2), dtype=np.int64)
    pixel = np.sqrt(abs(inverse[0, 0] * inverse[1, 1] - inverse[0, 1] * inverse[1, 0]))
    begin = 1.0 + margin + 0.5 * pixel
    n_inside = n_ring = 0
    for v in range(-half, half + 1):
        for u in range(-half, half + 1):
            radius = np.hypot(inverse[0, 0] * u + inverse[0, 1] * v, inverse[1, 0] * u + inverse[1, 1] * v)
            if radius <= 1.0 - margin:
                places[0, n_inside, 0], places[0, n_inside, 1] = u, v
                n_inside += 1
            elif begin < radius <= begin + ring_px * pixel:
                places[1, n_ring, 0], places[1, n_ring, 1] = u, v
                n_ring += 1
    return places[0, :n_inside].copy(), places[1, :n_ring].copy()


@njit(cache=True, nogil=True)
def median_picture(views):  # type: ignore[no-untyped-def]
    """Median of a few pictures for each pixel and channel; views: (n, height, width, 3) uint8."""
    n, height, width = views.shape[:3]
    median, several = np.empty((height, width, 3)), np.empty(n)
    for y in range(height):
        for x in range(width):
            for c in range(3):
                for k in range(n):
                    value, j = float(views[k, y, x, c]), k
                    while j > 0 and several[j - 1] > value:
                        several[j] = several[j - 1]
                        j -= 1
                    several[j] = value
                median[y, x, c] = 0.5 * (several[(n - 1) // 2] + several[n // 2])
    return median


@njit(cache=True, nogil=True)
def median_color(colors):  # type: ignore[no-untyped-def]
    """Median of each channel, (3,); colors: (n, 3)."""
    return np.array([np.median(colors[:, 0].copy()), np.median(colors[:, 1].copy()), np.median(colors[:, 2].copy())])


@njit(cache=True, nogil=True)
def _by_shade(colors, level, weights):  # type: ignore[no-untyped-def]
    """Write the weights that `_squared_distance` needs for each of n colours, (n, 3), into `weights`, (n, 3)."""
    shade, noise = level
    for k in range(len(colors)):
        for c in range(3):
            weights[k, c] = 1.0 / (3.0 * (noise * noise + (shade * colors[k, c]) ** 2))


@njit(cache=True, nogil=True)
def _squared_distance(frame, y, x, color, weight):  # type: ignore[no-untyped-def]
    """Weighted squared distance between a pixel's colour and `color`. Below 1, the colours are similar."""
    b, g, r = frame[y, x, 0] - color[0], frame[y, x, 1] - color[1], frame[y, x, 2] - color[2]
    return b * b * weight[0] + g * g * weight[1] + r * r * weight[2]


@njit(cache=True, nogil=True)
def likeness(frame, box, inside, ring, colors, core, behind, settings):  # type: ignore[no-untyped-def]
    """Compare a picture with a mark's appearance at each position in a box. Returns six values, (6, height, width).

    The values are the similarity of the pixels inside the mark, the share of these pixels that are similar, the
    similarity of the ring to the mark's colour, and the mark's median colour (three channels).
    """
    shade, noise, _, hidden = settings
    u0, v0, u1, v1 = box
    height, width = frame.shape[:2]
    evidence = np.zeros((6, v1 - v0, u1 - u0))
    weights, weight = np.empty(colors.shape), np.empty((2, 3))
    _by_shade(colors, (shade, noise), weights)
    _by_shade(np.stack((core, behind)), (shade, noise), weight)
    beside, unlike = np.empty((height, width)), np.empty((height, width))
    for y in range(height):
        for x in range(width):
            beside[y, x] = max(1.0 - _squared_distance(frame, y, x, core, weight[0]), -1.0)
            unlike[y, x] = 1.0 if _squared_distance(frame, y, x, behind, weight[1]) < 1.0 else hidden
    for v in range(v0, v1):
        for u in range(u0, u1):
            total, like = 0.0, 0
            for k in range(len(inside)):
                x, y = u + inside[k, 0], v + inside[k, 1]
                if x < 0 or y < 0 or x >= width or y >= height:
                    total -= hidden
                    continue
                distance = _squared_distance(frame, y, x, colors[k], weights[k])
                if distance < 1.0:
                    like += 1
                    total += 1.0 - distance
                else:
                    total -= unlike[y, x]
            around, n_ring = 0.0, 0
            for k in range(len(ring)):
                x, y = u + ring[k, 0], v + ring[k, 1]
                if 0 <= x < width and 0 <= y < height:
                    n_ring += 1
                    around += beside[y, x]
            evidence[0, v - v0, u - u0] = total / len(inside)
            evidence[1, v - v0, u - u0] = like / len(inside)
            evidence[2, v - v0, u - u0] = around / max(n_ring, 1)
            for c in range(3):
                evidence[3 + c, v - v0, u - u0] = core[c]
    return evidence


@njit(cache=True, nogil=True)
def likeness_in_other_light(frame, box, step, inside, ring, colors, core, settings):  # type: ignore[no-untyped-def]
    """Results of `likeness` at positions `step` pixels apart. The mark's colour is fitted at each position."""
    shade, noise, contrast, hidden = settings
    level = shade, noise
    u0, v0, u1, v1 = box
    height, width = frame.shape[:2]
    evidence = np.zeros((6, (v1 - v0 + step - 1) // step, (u1 - u0 + step - 1) // step))
    own_core, core_weight = core.reshape(1, 3).copy(), np.empty((1, 3))
    own_colors, weights = colors.copy(), np.empty(colors.shape)
    _by_shade(own_colors, level, weights)
    for v in range(v0, v1, step):
        for u in range(u0, u1, step):
            row, column = (v - v0) // step, (u - u0) // step
            _fit_core(frame, v, u, inside, colors, core, level, own_core, own_colors, weights)
            _by_shade(own_core, level, core_weight)
            total, like = 0.0, 0
            for k in range(len(inside)):
                x, y = u + inside[k, 0], v + inside[k, 1]
                if x < 0 or y < 0 or x >= width or y >= height:
                    total -= hidden
                    continue
                distance = _squared_distance(frame, y, x, own_colors[k], weights[k])
                if distance < 1.0:
                    like += 1
                    total += 1.0 - distance
                else:
                    total -= hidden
            around, n_ring = 0.0, 0
            for k in range(len(ring)):
                x, y = u + ring[k, 0], v + ring[k, 1]
                if 0 <= x < width and 0 <= y < height:
                    n_ring += 1
                    around += max(1.0 - contrast * _squared_distance(frame, y, x, own_core[0], core_weight[0]), -1.0)
            evidence[0, row, column] = total / len(inside)
            evidence[1, row, column] = like / len(inside)
            evidence[2, row, column] = around / max(n_ring, 1)
            for c in range(3):
                evidence[3 + c, row, column] = own_core[0, c]
    return evidence


@njit(cache=True, nogil=True)
def _fit_core(frame, v, u, inside, colors, core, level, own_core, own_colors, weights):  # type: ignore[no-untyped-def]
    """Fit the mark's colour at a position, first to all pixels, then only to the pixels of a similar colour.

    Writes the fitted colours into own_core, (1, 3), and own_colors, (n, 3), and the weights of own_colors into weights.
    """
    height, width = frame.shape[:2]
    sums, light = np.zeros(3), 1.0
    for turn in range(N_FITS):
        sums[:] = 0.0
        n = 0
        for k in range(len(inside)):
            x, y = u + inside[k, 0], v + inside[k, 1]
            if x < 0 or y < 0 or x >= width or y >= height:
                continue
            if turn == 0 or _squared_distance(frame, y, x, own_colors[k], weights[k]) < 1.0:
                n += 1
                for c in range(3):
                    sums[c] += frame[y, x, c] - light * (colors[k, c] - core[c])
        if n == 0:
            return
        for c in range(3):
            own_core[0, c] = max(sums[c] / n, 0.0)
        light = own_core.max() / max(core.max(), 1.0)
        for c in range(3):
            for k in range(len(inside)):
                own_colors[k, c] = own_core[0, c] + light * (colors[k, c] - core[c])
        _by_shade(own_colors, level, weights)
