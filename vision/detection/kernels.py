"""Compiled loops over pixels: colour classes of a picture, coverage of pixels by a mark, and outlines of marks.

Alpha is the share of a pixel that a mark covers. tests/vision/plain_coverage.py computes the same results with NumPy
and OpenCV. Kernels that call each other are in one file, because numba's disk cache ignores changes in other files.
"""

from __future__ import annotations

import numpy as np
from numba import njit

HUE_STEPS = 720
"""Number of steps of half a degree on the hue circle. The table of classes has one entry for each step."""
NARROW_PX = 12
"""Width of the border that is added around the pixels of a class, for the mark's edge and the background [px]."""
ON_A_LINE = 1e-6
"""Least determinant of the Gram matrix in a fit of the background, relative to the product of its diagonal elements."""
ROUNDING = 1.0 / 12.0
"""Variance of the error of rounding to whole grey levels."""
N_RAYS = 64
"""Number of rays from a mark's middle along which its edge is searched."""
RAYS = np.column_stack(
    [np.cos(2.0 * np.pi * np.arange(N_RAYS) / N_RAYS), np.sin(2.0 * np.pi * np.arange(N_RAYS) / N_RAYS)]
)
"""Directions of the rays as unit vectors, (N_RAYS, 2)."""
SETTLED = 1e-4
"""Length of a step below which a fit has converged, relative to the mark's half axes. Then, one last step follows."""


@njit(cache=True, nogil=True, fastmath=True)
def classify(bgr, table, least_value, least_saturation, classes):  # type: ignore[no-untyped-def]
    """Write the number of each pixel's class into `classes`, (h, w) uint8; 0 for no class.

    bgr: (h, w, 3) uint8
    table: class number of each hue step, (HUE_STEPS,) uint8
    least_value: least value of each class, 0 to 255, (n_classes + 1,); entry 0: minimum of the other entries
    least_saturation: least saturation of each class, 0 to 256, (n_classes + 1,); entry 0: minimum of the other entries
    """
    height, width = classes.shape
    for row in range(height):
        for column in range(width):
            b = np.int32(bgr[row, column, 0])
            g = np.int32(bgr[row, column, 1])
            r = np.int32(bgr[row, column, 2])
            value = max(b, g, r)
            chroma = value - min(b, g, r)
            found = np.uint8(0)
            if value >= least_value[0] and chroma * 256 >= least_saturation[0] * value and chroma > 0:
                if value == r:
                    sector = (g - b) / chroma
                elif value == g:
                    sector = 2.0 + (b - r) / chroma
                else:
                    sector = 4.0 + (r - g) / chroma
                found = table[int(sector * 120.0 + (HUE_STEPS + 0.5)) % HUE_STEPS]
                if value < least_value[found] or chroma * 256 < least_saturation[found] * value:
                    found = np.uint8(0)
            classes[row, column] = found


@njit(cache=True, nogil=True, fastmath=True)
def _inverse(m):  # type: ignore[no-untyped-def]
    """Determinant and inverse of a symmetric matrix, (3, 3); the inverse of a singular matrix is 0."""
    a, b, c, d, e, f = m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2]
    p, q, r = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * p + b * q + c * r
    scale = 0.0 if det == 0.0 else 1.0 / det
    inverse = np.empty((3, 3))
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = scale * p, scale * (a * f - c * c), scale * (a * d - b * b)
    inverse[0, 1] = inverse[1, 0] = scale * q
    inverse[0, 2] = inverse[2, 0] = scale * r
    inverse[1, 2] = inverse[2, 1] = scale * (b * c - a * e)
    return det, inverse


@njit(cache=True, nogil=True, fastmath=True)
def _grown(component, radius):  # type: ignore[no-untyped-def]
    """The component dilated by a disc of this radius. The disc has the same pixels as OpenCV's disc."""
    height, width = component.shape
    half_widths = np.empty(2 * radius + 1, dtype=np.int64)
    for k in range(2 * radius + 1):
        half_widths[k] = int(np.sqrt(radius**2 - (k - radius) ** 2) + 0.5)
    grown = np.zeros((height, width), dtype=np.uint8)
    for row in range(height):
        end = 0
        while end < width:
            if not component[row, end]:
                end += 1
                continue
            begin = end  # start of a run of pixels in a row
            while end < width and component[row, end]:
                end += 1
            for k in range(max(row - radius, 0), min(row + radius, height - 1) + 1):
                half = half_widths[k - row + radius]
                for m in range(max(begin - half, 0), min(end + half, width)):
                    grown[k, m] = 1
    return grown


@njit(cache=True, nogil=True, fastmath=True)
def _median(counts, n):  # type: ignore[no-untyped-def]
    """Twice the median of n whole numbers, as a whole number. counts: number of occurrences of 0, 1, 2 ..."""
    low, high, below = -1, -1, 0
    for value in range(len(counts)):
        below += counts[value]
        if low < 0 and 2 * below >= n:
            low = value
        if 2 * below > n:
            high = value
            break
    return low + high


@njit(cache=True, nogil=True, fastmath=True)
def _usual(colors, outlier_sds):  # type: ignore[no-untyped-def]
    """Whether each of n colours, (n, 3), is within outlier_sds standard deviations of the median colour, (n,)."""
    n = len(colors)
    kept, fourth = np.ones(n, dtype=np.bool_), (n + 3) // 4
    counts, spread = np.empty(256, dtype=np.int64), np.empty(511, dtype=np.int64)
    for c in range(3):
        counts[:], spread[:] = 0, 0
        for i in range(0, n, 4):
            counts[colors[i, c]] += 1
        middle = _median(counts, fourth)
        for i in range(0, n, 4):
            spread[abs(2 * colors[i, c] - middle)] += 1
        # For a Gaussian, 1.4826 MAD is the standard deviation. Two grey levels are added for shading.
        limit = 2.0 * outlier_sds * (1.4826 * _median(spread, fourth) / 4.0 + 2.0)
        for i in range(n):
            kept[i] &= abs(2 * colors[i, c] - middle) <= limit
    return kept


@njit(cache=True, nogil=True, fastmath=True)
def _background(patch, behind, outlier_sds, fit_pixels):  # type: ignore[no-untyped-def]
    """Linear model of the background's colour, fitted to background pixels.

    behind: 1 on background pixels, else 0, (h, w) uint8
    Returns whether the pixels determine the fit, and three matrices (3, 3). The rows of the first matrix are the
    coefficients of 1, column and row; it has one column for each channel. The second matrix is the inverse Gram matrix
    of the fit. The third is the covariance of the channels' noise.
    """
    none = np.zeros((3, 3))
    height, width = behind.shape
    total = 0
    for row in range(height):
        for column in range(width):
            total += behind[row, column]
    step = 1 + total // fit_pixels
    n = (total + step - 1) // step
    if n < 12:
        return False, none, none, none
    places, colors = np.empty((n, 2)), np.empty((n, 3), dtype=np.int64)
    k = met = 0
    for row in range(height):
        for column in range(width):
            if behind[row, column]:
                if met == k * step:
                    places[k, 0], places[k, 1] = column, row
                    for c in range(3):
                        colors[k, c] = patch[row, column, c]
                    k += 1
                met += 1
    kept = _usual(colors, outlier_sds)
    n_kept = sum_u = sum_v = sum_uu = sum_uv = sum_vv = 0.0
    sums = np.zeros((3, 3))
    for i in range(n):
        if kept[i]:
            u, v = places[i, 0], places[i, 1]
            n_kept += 1.0
            sum_u += u
            sum_v += v
            sum_uu += u * u
            sum_uv += u * v
            sum_vv += v * v
            for c in range(3):
                color = float(colors[i, c])
                sums[0, c] += color
                sums[1, c] += u * color
                sums[2, c] += v * color
    gram = np.array([[n_kept, sum_u, sum_v], [sum_u, sum_uu, sum_uv], [sum_v, sum_uv, sum_vv]])
    det, gram_inv = _inverse(gram)
    if n_kept < 12 or det <= ON_A_LINE * gram[0, 0] * gram[1, 1] * gram[2, 2]:
        return False, none, none, none
    plane = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            for c in range(3):
                plane[a, c] += gram_inv[a, b] * sums[b, c]
    # Outliers are part of this covariance. So the colour of a line or a disc beside the mark hardly changes alpha.
    noise_cov = np.zeros((3, 3))
    stray = np.empty(3)
    for i in range(n):
        for c in range(3):
            stray[c] = colors[i, c] - plane[0, c] - places[i, 0] * plane[1, c] - places[i, 1] * plane[2, c]
        for a in range(3):
            for c in range(a, 3):
                noise_cov[a, c] += stray[a] * stray[c]
    for a in range(3):
        for c in range(a, 3):
            noise_cov[a, c] /= n - 3
            noise_cov[c, a] = noise_cov[a, c]
        noise_cov[a, a] += ROUNDING
    return True, plane, gram_inv, noise_cov


@njit(cache=True, nogil=True, fastmath=True)
def _boxed(values, reach):  # type: ignore[no-untyped-def]
    """Mean over a square around each pixel, (h, w). reach: odd width of the square. Values outside the patch are 0."""
    height, width = values.shape
    half = reach // 2
    across, boxed = np.empty((height, width)), np.empty((height, width))
    for row in range(height):
        total = 0.0
        for column in range(min(half, width)):
            total += values[row, column]
        for column in range(width):
            if column + half < width:
                total += values[row, column + half]
            if column > half:
                total -= values[row, column - half - 1]
            across[row, column] = total
    down = np.zeros(width)
    for row in range(-half, height):
        for column in range(width):
            if row + half < height:
                down[column] += across[row + half, column]
            if row > half:
                down[column] -= across[row - half - 1, column]
            if row >= 0:
                boxed[row, column] = down[column] / reach**2
    return boxed


@njit(cache=True, nogil=True, fastmath=True)
def _power(noise, weights, reach):  # type: ignore[no-untyped-def]
    """Variance of the mean of noisy pixels, multiplied by the number of these pixels.

    weights: weight of each pixel's noise, (h, w); 0 for unused pixels
    The result is the sum of the noise's autocovariance over lags up to `reach // 2`, or over lag 0 for white noise.
    """
    weighted = noise * weights
    boxed_noise, boxed_weights = _boxed(weighted, reach), _boxed(weights, reach)
    squares = pairs = weights2 = weight_pairs = weight_sum = 0.0
    for row in range(noise.shape[0]):
        for column in range(noise.shape[1]):
            w, x = weights[row, column], weighted[row, column]
            squares += x * x
            pairs += x * boxed_noise[row, column]
            weights2 += w * w
            weight_pairs += w * boxed_weights[row, column]
            weight_sum += w
    variance = squares / weights2
    power = reach**2 * pairs / weight_pairs
    n_pixels = weight_sum**2 / weights2
    # The sum over n pixels of white noise has a relative error of about reach / sqrt(n). Only a sum that exceeds the
    # variance by twice this shows correlated noise.
    return power if power > variance * (1.0 + 2.0 * reach / np.sqrt(n_pixels)) else variance


@njit(cache=True, nogil=True, fastmath=True)
def _smooth(alpha):  # type: ignore[no-untyped-def]
    """Alpha, smoothed with weights 1 2 1 along rows and along columns. The patch is mirrored at its border."""
    height, width = alpha.shape
    across, smooth = np.empty((height, width)), np.empty((height, width))
    for row in range(height):
        for column in range(width):
            left = alpha[row, column - 1 if column > 0 else 1]
            right = alpha[row, column + 1 if column < width - 1 else width - 2]
            across[row, column] = (left + 2.0 * alpha[row, column] + right) / 4.0
    for row in range(height):
        above, below = row - 1 if row > 0 else 1, row + 1 if row < height - 1 else height - 2
        for column in range(width):
            smooth[row, column] = (across[above, column] + 2.0 * across[row, column] + across[below, column]) / 4.0
    return smooth


@njit(cache=True, nogil=True, fastmath=True)
def _lanczos(fraction):  # type: ignore[no-untyped-def]
    """Lanczos weights of pixels -3 to 4, (8,), to interpolate between pixels 0 and 1 at the position `fraction`."""
    weights = np.empty(8)
    for k in range(8):
        x = fraction - (k - 3)
        weights[k] = np.sinc(x) * np.sinc(x / 4.0)
    return weights / weights.sum()


@njit(cache=True, nogil=True, fastmath=True)
def _lopsided(alpha, where, center_u, center_v):  # type: ignore[no-untyped-def]
    """Half the difference of alpha between each pixel and its point reflection about the centre, (h, w).

    A mark has the same alpha in both pixels. The difference therefore shows noise, compression and wear.
    """
    height, width = alpha.shape
    smooth = _smooth(alpha)
    first_u, first_v = np.floor(2.0 * center_u), np.floor(2.0 * center_v)
    along_u, along_v = _lanczos(2.0 * center_u - first_u), _lanczos(2.0 * center_v - first_v)
    lopsided = np.zeros((height, width))
    for row in range(height):
        for column in range(width):
            if where[row, column] == 0.0:
                continue
            turned = 0.0
            for i in range(8):
                v = min(max(int(first_v) - row + i - 3, 0), height - 1)
                line = 0.0
                for j in range(8):
                    u = min(max(int(first_u) - column + j - 3, 0), width - 1)
                    line += along_u[j] * smooth[v, u]
                turned += along_v[i] * line
            lopsided[row, column] = (smooth[row, column] - turned) / 2.0
    return lopsided


@njit(cache=True, nogil=True, fastmath=True)
def _contrast(patch, solid, plane):  # type: ignore[no-untyped-def]
    """Number of pixels in the mask `solid`, their mean colour, and its difference from the background, each (3,)."""
    color, contrast = np.zeros(3), np.zeros(3)
    n = u = v = 0
    for row in range(solid.shape[0]):
        for column in range(solid.shape[1]):
            if solid[row, column]:
                n += 1
                u += column
                v += row
                for c in range(3):
                    color[c] += patch[row, column, c]
    if n:
        for c in range(3):
            color[c] /= n
            contrast[c] = color[c] - plane[0, c] - (u * plane[1, c] + v * plane[2, c]) / n
    return n, color, contrast


@njit(cache=True, nogil=True, fastmath=True)
def _unmixed(patch, plane, weights, near, core):  # type: ignore[no-untyped-def]
    """Alpha, (h, w): 1 in the mark's core, `(pixel - background) @ weights` in the rest of `near`, 0 elsewhere.

    Let u be the column and v the row. Also returns two tuples of sums: sums of alpha, `alpha * u` and `alpha * v` over
    all pixels, and sums of 1, u, v, `u * u`, `u * v` and `v * v` over the pixels of `near` outside the core.
    """
    by_b, by_g, by_r = weights
    constant = plane[0, 0] * by_b + plane[0, 1] * by_g + plane[0, 2] * by_r
    along_u = plane[1, 0] * by_b + plane[1, 1] * by_g + plane[1, 2] * by_r
    along_v = plane[2, 0] * by_b + plane[2, 1] * by_g + plane[2, 2] * by_r
    alpha = np.zeros(near.shape)
    area = sum_u = sum_v = 0.0
    n = u = v = uu = uv = vv = 0
    for row in range(near.shape[0]):
        for column in range(near.shape[1]):
            if not near[row, column]:
                continue
            share = 1.0
            if not core[row, column]:
                x = by_b * patch[row, column, 0] + by_g * patch[row, column, 1] + by_r * patch[row, column, 2]
                share = x - constant - along_u * column - along_v * row
                n += 1
                u += column
                v += row
                uu += column * column
                uv += column * row
                vv += row * row
            alpha[row, column] = share
            area += share
            sum_u += share * column
            sum_v += share * row
    return alpha, (area, sum_u, sum_v), (n, u, v, uu, uv, vv)


@njit(cache=True, nogil=True, fastmath=True)
def _leverage(near, core, area, u, v):  # type: ignore[no-untyped-def]
    """Shift of the mark's centre per unit of alpha at each edge pixel, (h, w); 0 at other pixels."""
    lengths = np.zeros(near.shape)
    for row in range(near.shape[0]):
        for column in range(near.shape[1]):
            if near[row, column] and not core[row, column]:
                lengths[row, column] = np.sqrt((column - u) ** 2 + (row - v) ** 2) / area
    return lengths


@njit(cache=True, nogil=True, fastmath=True)
def _center_cov(edge, center, gram_inv, variances, floor_px2):  # type: ignore[no-untyped-def]
    """Covariance uu, uv, vv of a mark's centre [px²].

    edge: sums over edge pixels, from `_unmixed`; center: u, v and area of the mark
    gram_inv: inverse Gram matrix from `_background`; variances: variance of alpha at the edge and in the background
    """
    (n, sum_u, sum_v, sum_uu, sum_uv, sum_vv), (u, v, area), (at_edge, behind) = edge, center, variances
    # sums of the products of d center / d alpha = (place - center) / area with (1, column, row), and with itself
    by_u = (sum_u - n * u) / area, (sum_uu - u * sum_u) / area, (sum_uv - u * sum_v) / area
    by_v = (sum_v - n * v) / area, (sum_uv - v * sum_u) / area, (sum_vv - v * sum_v) / area
    uu, vv = (by_u[1] - u * by_u[0]) / area, (by_v[2] - v * by_v[0]) / area
    uv = (by_u[2] - v * by_u[0]) / area
    # Errors of the background model, due to noise in its fit, also affect the centre.
    plane_uu = plane_uv = plane_vv = 0.0
    for a in range(3):
        for b in range(3):
            plane_uu += by_u[a] * gram_inv[a, b] * by_u[b]
            plane_uv += by_u[a] * gram_inv[a, b] * by_v[b]
            plane_vv += by_v[a] * gram_inv[a, b] * by_v[b]
    return (
        at_edge * uu + behind * plane_uu + floor_px2,
        at_edge * uv + behind * plane_uv,
        at_edge * vv + behind * plane_vv + floor_px2,
    )


@njit(cache=True, nogil=True, fastmath=True)
def covered(patch, component, others, grow, settings, fit_pixels, thorough):  # type: ignore[no-untyped-def]
    """Measure alpha, the share of each pixel that a mark covers.

    patch: (h, w, 3) uint8 BGR; component, others: 0 and 1, (h, w) uint8, as in `measure_coverage`
    grow: radius of the disc by which the component is dilated [px]
    settings: from `CoverageSettings.for_kernel`
    fit_pixels: largest number of pixels for the fit of the background; thorough: as in `measure_coverage`
    Returns whether the measurement succeeded, alpha, (h, w), and ten values of the mark: the centre u, v, the centre's
    covariance uu uv vv, area, noise of alpha, and colour b g r.
    """
    outlier_sds, lag, core_px, edge_gain, floor_px2 = settings
    one = np.uint8(1)
    near = _grown(component, grow)
    core = one - _grown(one - component, core_px)
    ring = (one - near) * (one - others)
    figures = np.zeros(10)
    there, plane, gram_inv, noise_cov = _background(patch, ring, outlier_sds, fit_pixels)
    if not there:
        return False, np.zeros(ring.shape), figures
    n, color, contrast = _contrast(patch, core, plane)
    if n < 9:
        _, color, contrast = _contrast(patch, component, plane)
    # Best linear unbiased estimate of alpha where pixel = background + alpha contrast + noise, noise ~ (0, N):
    # alpha = d' N^-1 (pixel - background) / d' N^-1 d
    _, noise_inv = _inverse(noise_cov)
    weights, strength = np.zeros(3), 0.0
    for a in range(3):
        for b in range(3):
            weights[a] += noise_inv[a, b] * contrast[b]
        strength += weights[a] * contrast[a]
    if not strength > 0:
        return False, np.zeros(ring.shape), figures
    weights /= strength
    alpha, (area, sum_u, sum_v), edge = _unmixed(patch, plane, weights, near, core)
    if not area > 0:
        return False, alpha, figures
    u, v = sum_u / area, sum_v / area
    # Approximation: the noise is an average over squares of width lag + 1. Then its autocovariance sums to (lag + 1)²
    # variances.
    behind = at_edge = (lag + 1) ** 2 / strength
    if thorough:
        # Noise is weighted by its effect on the centre, because compression causes more noise at the mark's edge.
        leverage, none = _leverage(near, core, area, u, v), np.zeros_like(near)
        measured, _, _ = _unmixed(patch, plane, weights, one - none, none)
        behind = _power(measured, ring.astype(np.float64), 2 * lag + 1)
        at_edge = edge_gain * _power(_lopsided(measured, leverage, u, v), leverage, lag)
    figures[0], figures[1] = u, v
    cov = _center_cov(edge, (u, v, area), gram_inv, (max(behind, at_edge), behind), floor_px2)
    figures[5], figures[6] = area, 1.0 / np.sqrt(strength)
    for a in range(3):
        figures[2 + a], figures[7 + a] = cov[a], color[a]
    return True, alpha, figures


@njit(cache=True, nogil=True, fastmath=True)
def _edges(alpha, start, shape, reach):  # type: ignore[no-untyped-def]
    """Outermost point on each ray at which alpha falls below 0.5, relative to `start` [half axes]; number of points."""
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


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _through(a, b, c):  # type: ignore[no-untyped-def]
    """Centre and radius of the circle through three points; the radius is 0 if the points are on a line."""
    bx, by, cx, cy = b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]
    d = 2.0 * (bx * cy - by * cx)
    if abs(d) < 1e-9:
        return 0.0, 0.0, 0.0
    b2, c2 = bx * bx + by * by, cx * cx + cy * cy
    x, y = (cy * b2 - by * c2) / d, (bx * c2 - cx * b2) / d
    return a[0] + x, a[1] + y, np.sqrt(x * x + y * y)


@njit(cache=True, nogil=True, fastmath=True)
def _candidate(edges, size_sd, near):  # type: ignore[no-untyped-def]
    """Best circle (x, y, size) through three edge points: many edge points on it, few beyond it, a size near 1."""
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
                # An occluding object moves a mark's edge inward, never outward.
                if squared > outer:
                    score -= 1.0
                elif squared > inner:
                    score += 1.0
                if score + (n - 1 - k) <= best:
                    break
            if score > best:
                best = score
                fit[0], fit[1], fit[2] = x, y, size
    return fit


@njit(cache=True, nogil=True, fastmath=True)
def _moved(fit, inverse, gradient):  # type: ignore[no-untyped-def]
    """Change the circle `fit` by a Newton step. Returns the largest change of x, y and size."""
    largest = 0.0
    for a in range(3):
        step = inverse[a, 0] * gradient[0] + inverse[a, 1] * gradient[1] + inverse[a, 2] * gradient[2]
        fit[a] += step
        largest = max(largest, abs(step))
    return largest


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _refined(edges, start, size_sd, scale, settings):  # type: ignore[no-untyped-def]
    """Fit a circle to edge points by Tukey's robust least squares, beginning with the circle `start`.

    Returns the circle (x, y, size), the inverse of the normal matrix, (3, 3), the variance of an edge point, the mean
    power of the waves in the residuals, the share of rays with an edge point on the circle, and the share of rays with
    an edge point outside the circle.
    """
    n = len(edges)
    fit, inverse = start.copy(), np.zeros((3, 3))
    near, floor, highest_wave = settings[0] / scale, (settings[3] / scale) ** 2, int(settings[2])
    variance, n_on, n_beyond = floor, 0.0, 0
    waves = np.zeros((highest_wave + 1, 2))
    settled = False
    for turn in range(6):
        last = settled or turn == 5
        # weight of the size's prior, relative to that of an edge point
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
            # Tukey's biweight. The derivative of the error is -(x, y) / length for the centre and -1 for the size.
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
        det, inverse = _inverse(normal)
        if n_on < 3.0 or abs(det) < 1e-9:
            return fit, inverse, variance, 0.0, 0.0, 0.0
        largest = _moved(fit, inverse, (g0, g1, g2))
        narrower, variance = variance, max(squares / n_on, floor)
        if last:
            break
        settled = abs(variance - narrower) < 0.01 * variance and largest < SETTLED
    # A shift of the centre is a wave of order 1 around the outline. Its power due to noise, highlights and compression
    # is assumed to be the mean power of the waves of higher order in the residuals.
    power = (waves**2).sum() / (highest_wave - 1) / weights2
    return fit, inverse, variance, power, n_on / N_RAYS, n_beyond / N_RAYS


@njit(cache=True, nogil=True)
def fitted(alpha, start, shape, size_sd, settings):  # type: ignore[no-untyped-def]
    """Fit an outline to a mark's visible edge.

    alpha: (h, w); start: a point inside the visible part, (2,); shape, size_sd: as in `Outline`
    settings: from `OutlineSettings.for_kernel`
    Returns the centre u, v, its covariance uu, uv, vv, and `share`, `beyond`, `size` of `Fitted`.
    """
    near_px, correlation_px, _, _, min_share, whole_share, reach = settings
    fit = np.array([start[0], start[1], 1.0, 0.0, 1.0, 0.0, 0.0, 1.0])
    edges, n_edges = _edges(alpha, start, shape, reach)
    if n_edges < min_share * N_RAYS:
        return fit
    edges = edges[:n_edges]
    (a, b), (c, d) = shape[0], shape[1]
    scale = np.sqrt(abs(a * d - b * c))
    middle = np.array([edges[:, 0].mean(), edges[:, 1].mean(), 1.0])
    circle, inverse, variance, power, share, beyond = _refined(edges, middle, size_sd, scale, settings)
    if share <= whole_share:
        start_at = _candidate(edges, size_sd, near_px / scale)
        circle, inverse, variance, power, share, beyond = _refined(edges, start_at, size_sd, scale, settings)
    fit[5], fit[6] = share, beyond
    if share == 0.0:
        return fit
    # Errors of neighbouring edge points are correlated. The corners of a covered part also cause a small bias.
    together = max(1.0, correlation_px * N_RAYS / (2.0 * np.pi * scale * circle[2])) / share
    error = max(variance * together, power / share)
    xx, xy, yy = inverse[0, 0], inverse[0, 1], inverse[1, 1]
    fit[0] += a * circle[0] + b * circle[1]
    fit[1] += c * circle[0] + d * circle[1]
    fit[2] = error * (a * a * xx + 2.0 * a * b * xy + b * b * yy)
    fit[3] = error * (a * c * xx + (a * d + b * c) * xy + b * d * yy)
    fit[4] = error * (c * c * xx + 2.0 * c * d * xy + d * d * yy)
    fit[7] = circle[2]
    return fit


@njit(cache=True, nogil=True)
def agreed(one, other, share, limits):  # type: ignore[no-untyped-def]
    """Whether two centres of a mark agree, and their squared Mahalanobis distance.

    one, other: arrays whose first five values are a centre u, v and the centre's covariance uu, uv, vv
    share: area of the mark, relative to the area of its outline; limits: from `CenterSettings.for_kernel`
    """
    min_area, max_area, variance, gate = limits
    a, b, c = one[2] + other[2] + variance, one[3] + other[3], one[4] + other[4] + variance
    du, dv = other[0] - one[0], other[1] - one[1]
    squared = (c * du * du - 2.0 * b * du * dv + a * dv * dv) / (a * c - b * b)
    return min_area <= share <= max_area and squared <= gate, squared


@njit(cache=True, nogil=True)
def _without_gaps(piece):  # type: ignore[no-untyped-def]
    """Whether the pixels of a piece are contiguous in each row, so that the piece has no holes."""
    for row in range(piece.shape[0]):
        runs = 0
        for column in range(1, piece.shape[1]):
            runs += piece[row, column] > piece[row, column - 1]
        if runs > 1:
            return False
    return True


@njit(cache=True, nogil=True)
def _only_piece(classes, number, fewest):  # type: ignore[no-untyped-def]
    """Find the only large connected piece of a class.

    Returns whether there is exactly one large piece, away from the border, and all other pieces are negligible. Also
    returns the mask of this piece with filled holes, (h, w), and its first row, last row, first and last column.
    """
    height, width = classes.shape
    piece = np.zeros((height, width), dtype=np.uint8)
    stack = np.empty((height * width, 2), dtype=np.int64)
    seen = np.zeros((height, width), dtype=np.uint8)
    found, stray, rim = False, 0, (0, 0, 0, 0)
    for row in range(height):
        for column in range(width):
            if classes[row, column] != number or seen[row, column]:
                continue
            n, met = 1, 0
            stack[0, 0], stack[0, 1] = row, column
            seen[row, column] = 1
            while met < n:  # the stack holds all pixels of the piece
                i, j = stack[met, 0], stack[met, 1]
                met += 1
                for k in range(max(i - 1, 0), min(i + 2, height)):
                    for m in range(max(j - 1, 0), min(j + 2, width)):
                        if classes[k, m] == number and not seen[k, m]:
                            seen[k, m] = 1
                            stack[n, 0], stack[n, 1] = k, m
                            n += 1
            if n < fewest:
                stray += n
                continue
            if found:
                return False, piece, rim
            found = True
            low_v, high_v, low_u, high_u = height, 0, width, 0
            for p in range(n):
                i, j = stack[p, 0], stack[p, 1]
                piece[i, j] = 1
                low_v, high_v, low_u, high_u = min(low_v, i), max(high_v, i), min(low_u, j), max(high_u, j)
            rim = (low_v, high_v, low_u, high_u)
            if low_v == 0 or low_u == 0 or high_v == height - 1 or high_u == width - 1:
                return False, piece, rim
    if not found or stray > fewest // 4:
        return False, piece, rim
    if _without_gaps(piece):
        return True, piece, rim
    # flood fill from a corner: pixels that are neither reached nor in the piece are holes
    outside = np.zeros((height, width), dtype=np.uint8)
    stack[0, 0], stack[0, 1] = 0, 0
    outside[0, 0], n = 1, 1
    while n > 0:
        n -= 1
        i, j = stack[n, 0], stack[n, 1]
        for k, m in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
            if 0 <= k < height and 0 <= m < width and not piece[k, m] and not outside[k, m]:
                outside[k, m] = 1
                stack[n, 0], stack[n, 1] = k, m
                n += 1
    return True, np.uint8(1) - outside, rim


@njit(cache=True, nogil=True)
def _narrowed(frame, box, number, palette):  # type: ignore[no-untyped-def]
    """Whether a box has pixels of a class, and a smaller box that contains them. Only every fourth pixel is tested."""
    table, least_value, least_saturation = palette
    left, top, right, bottom = box
    one = np.empty((1, (right - left + 1) // 2), dtype=np.uint8)
    low_v, high_v, low_u, high_u = bottom, -1, right, -1
    for row in range(top, bottom, 2):
        classify(frame[row : row + 1, left:right:2], table, least_value, least_saturation, one)
        for k in range(one.shape[1]):
            if one[0, k] == number:
                low_v, high_v = min(low_v, row), row
                low_u, high_u = min(low_u, left + 2 * k), max(high_u, left + 2 * k)
    low = max(low_u - NARROW_PX, left), max(low_v - NARROW_PX, top)
    high = min(high_u + NARROW_PX + 1, right), min(high_v + NARROW_PX + 1, bottom)
    return high_v >= 0, (low[0], low[1], high[0], high[1])


@njit(cache=True, nogil=True)
def _alone(frame, box, number, palette, fewest, settings):  # type: ignore[no-untyped-def]
    """Whether a box has exactly one mark of a class, left and top of the mark's patch, and results of `covered`."""
    pad_px, covering, fit_pixels = settings
    none, no_figures = np.zeros((1, 1)), np.zeros(10)
    grow = covering[1] + min(box[2] - box[0], box[3] - box[1]) // 20
    there, (left, top, right, bottom) = _narrowed(frame, box, number, palette)
    if not there:
        return False, 0, 0, none, no_figures
    height, width = bottom - top, right - left
    classes = np.empty((height, width), dtype=np.uint8)
    # The picture is not smoothed: if noise breaks a mark into pieces, `detect_marks` finds it later.
    classify(frame[top:bottom, left:right], palette[0], palette[1], palette[2], classes)
    there, piece, (low_v, high_v, low_u, high_u) = _only_piece(classes, number, fewest)
    if not there:
        return False, 0, 0, none, no_figures
    pad = pad_px + max(high_v - low_v + 1, high_u - low_u + 1) // 8
    v0, u0 = max(low_v - pad, 0), max(low_u - pad, 0)
    v1, u1 = min(high_v + 1 + pad, height), min(high_u + 1 + pad, width)
    patch = frame[top + v0 : top + v1, left + u0 : left + u1].copy()
    component = piece[v0:v1, u0:u1].copy()
    thorough = np.bool_(False)  # not the literal False, for which numba would compile the kernel a second time
    valid, alpha, figures = covered(patch, component, np.zeros_like(component), grow, covering, fit_pixels, thorough)
    return valid, left + u0, top + v0, alpha, figures


@njit(cache=True, nogil=True)
def isolated(frame, boxes, classes, outlines, palette, covering, fitting, limits):  # type: ignore[no-untyped-def]
    """Find the only mark of a class in each of n boxes. Returns whether it is found whole, (n,), and data, (n, 11).

    frame: (h, w, 3) uint8; boxes: left, top, right, bottom, (n, 4)
    classes: colour class of each mark, and least number of pixels of each mark, (n, 2)
    palette: table, least_value and least_saturation of `classify`
    outlines: shape_px, (n, 2, 2); size_sd and area_px, (n, 2), as in `Outline`
    covering: border around a mark [px], and the arguments settings and fit_pixels of `covered`
    fitting: argument settings of `fitted`; limits: argument limits of `agreed`
    The data are the centre u, v, the centre's covariance uu uv vv, size, area, noise of alpha, colour b g r.
    """
    (shapes, sizes), min_share, n = outlines, fitting[4], len(boxes)
    found, marks = np.zeros(n, dtype=np.bool_), np.zeros((n, 11))
    for k in range(n):
        box = (boxes[k, 0], boxes[k, 1], boxes[k, 2], boxes[k, 3])
        valid, left, top, alpha, figures = _alone(frame, box, classes[k, 0], palette, classes[k, 1], covering)
        if not valid:
            continue
        fit = fitted(alpha, figures[:2], shapes[k], sizes[k, 0], fitting)
        agree, squared = agreed(figures, fit, figures[5] / sizes[k, 1], limits)
        found[k] = agree and fit[5] >= min_share
        marks[k, 0], marks[k, 1], marks[k, 5] = fit[0] + left, fit[1] + top, fit[7]
        for a in range(2, 5):
            marks[k, a] = max(1.0, squared / 2.0) * fit[a]
        for a in range(5, 10):
            marks[k, 1 + a] = figures[a]
    return found, marks
