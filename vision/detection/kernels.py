"""Compiled loops over pixels: colour classes of a picture, and how much of each pixel a mark covers.

tests/vision/plain_coverage.py computes the same with NumPy and OpenCV. Kernels that call each other stay in one file:
numba's cache on disk does not see changes across files.
"""

from __future__ import annotations

import numpy as np
from numba import njit

HUE_STEPS = 720
"""Half degrees on the circle of hues: what a table of classes is indexed by."""
NARROW_PX = 12
"""Around the pixels of a mark that is measured alone: its edge, and what lies behind it."""
ON_A_LINE = 1e-6
"""Determinant of the Gram matrix by its diagonal's product, below which positions do not determine a plane."""
ROUNDING = 1.0 / 12.0
"""Variance of rounding to whole grey levels."""


@njit(cache=True, nogil=True, fastmath=True)
def classify(bgr, table, least_value, least_saturation, classes):  # type: ignore[no-untyped-def]
    """Write the class of each pixel, (h, w) uint8; 0 for none.

    bgr: (h, w, 3) uint8
    table: class of each half degree of hue, (HUE_STEPS,) uint8
    least_value, least_saturation: by class, 0 to 255 and 0 to 256, (n_classes + 1,); [0] is the least of all
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
def _grown(component, half_widths):  # type: ignore[no-untyped-def]
    """The component dilated by a disc; half_widths: of the disc, row by row."""
    height, width = component.shape
    radius = len(half_widths) // 2
    grown = component.copy()
    for row in range(height):
        for column in range(width):
            if not component[row, column]:
                continue
            inside = (
                (row == 0 or component[row - 1, column])
                and (row == height - 1 or component[row + 1, column])
                and (column == 0 or component[row, column - 1])
                and (column == width - 1 or component[row, column + 1])
            )
            if inside:
                continue
            for k in range(max(row - radius, 0), min(row + radius, height - 1) + 1):
                half = half_widths[k - row + radius]
                grown[k, max(column - half, 0) : min(column + half, width - 1) + 1] = 1
    return grown


@njit(cache=True, nogil=True, fastmath=True)
def _median(counts, n):  # type: ignore[no-untyped-def]
    """Twice the median of n whole numbers, from their counts."""
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
def _background(patch, ring, outlier_sds, fit_pixels):  # type: ignore[no-untyped-def]
    """A mark's background: whether it is determined; plane, inverse Gram matrix and noise of its colours, (3, 3)."""
    none = np.zeros((3, 3))
    height, width = ring.shape
    total = 0
    for row in range(height):
        for column in range(width):
            total += ring[row, column]
    step = 1 + total // fit_pixels
    n = (total + step - 1) // step
    if n < 12:
        return False, none, none, none
    places = np.empty((n, 3))
    colors = np.empty((n, 3), dtype=np.int64)
    k = met = 0
    for row in range(height):
        for column in range(width):
            if ring[row, column]:
                if met % step == 0:
                    places[k, 0], places[k, 1], places[k, 2] = 1.0, column, row
                    for c in range(3):
                        colors[k, c] = patch[row, column, c]
                    k += 1
                met += 1
    kept = np.ones(n, dtype=np.bool_)
    fourth = (n + 3) // 4
    for c in range(3):
        counts = np.zeros(256, dtype=np.int64)
        for i in range(0, n, 4):
            counts[colors[i, c]] += 1
        middle = _median(counts, fourth)
        spread = np.zeros(511, dtype=np.int64)
        for i in range(0, n, 4):
            spread[abs(2 * colors[i, c] - middle)] += 1
        # 1.4826 MAD is the standard deviation of a Gaussian; two grey levels allow for shading.
        limit = 2.0 * outlier_sds * (1.4826 * _median(spread, fourth) / 4.0 + 2.0)
        for i in range(n):
            if abs(2 * colors[i, c] - middle) > limit:
                kept[i] = False
    gram, sums, n_kept = np.zeros((3, 3)), np.zeros((3, 3)), 0
    for i in range(n):
        if kept[i]:
            n_kept += 1
            for a in range(3):
                for c in range(3):
                    gram[a, c] += places[i, a] * places[i, c]
                    sums[a, c] += places[i, a] * colors[i, c]
    if n_kept < 12 or np.linalg.det(gram) <= ON_A_LINE * gram[0, 0] * gram[1, 1] * gram[2, 2]:
        return False, none, none, none
    # inverses: the matrices are 3 x 3, and LAPACK's solver takes three times as long to compile
    gram_inv = np.ascontiguousarray(np.linalg.inv(gram))
    plane = gram_inv @ sums
    # All pixels are used: a line or a disc of another hue beside the mark turns the weights away from its colour.
    noise_cov = np.zeros((3, 3))
    stray = np.empty(3)
    for i in range(n):
        for c in range(3):
            stray[c] = colors[i, c] - plane[0, c] - places[i, 1] * plane[1, c] - places[i, 2] * plane[2, c]
        for a in range(3):
            for c in range(3):
                noise_cov[a, c] += stray[a] * stray[c]
    return True, plane, gram_inv, noise_cov / (n - 3) + ROUNDING * np.eye(3)


@njit(cache=True, nogil=True, fastmath=True)
def _boxed(values, reach):  # type: ignore[no-untyped-def]
    """Means over squares of this width, (h, w); 0 beyond the patch."""
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
    """Sum of the noise's autocovariance over the lags in a square of width `reach`, not less than its variance.

    weights: how much each pixel's noise matters, (h, w), 0 where it does not count.
    The variance of a mean of n pixels is that sum over n. White noise: its variance. Grainy noise: more.
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
    # For white noise of n pixels the sum is the variance, up to reach / sqrt(n) of it: only an excess over that is
    # grain.
    return power if power > variance * (1.0 + 2.0 * reach / np.sqrt(n_pixels)) else variance


@njit(cache=True, nogil=True, fastmath=True)
def _smooth(alpha):  # type: ignore[no-untyped-def]
    """Alpha weighed 1 2 1 by 1 2 1, mirrored at the rim."""
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
    """Weights of the eight pixels from 3 before to 4 after a place this far behind one, (8,)."""
    weights = np.empty(8)
    for k in range(8):
        x = fraction - (k - 3)
        weights[k] = np.sinc(x) * np.sinc(x / 4.0)
    return weights / weights.sum()


@njit(cache=True, nogil=True, fastmath=True)
def _lopsided(alpha, where, center_u, center_v):  # type: ignore[no-untyped-def]
    """Half the difference of alpha from itself turned by 180 degrees about the centre, (h, w), on the given pixels.

    A mark is symmetric under that turn. The difference is noise, compression and wear, which can move the centre.
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
    """Colour of the mark, and its contrast to the background there, (3,) each."""
    color, middle = np.zeros(3), np.zeros(3)
    for row in range(solid.shape[0]):
        for column in range(solid.shape[1]):
            if solid[row, column]:
                middle[0] += 1.0
                middle[1] += column
                middle[2] += row
                color[0] += patch[row, column, 0]
                color[1] += patch[row, column, 1]
                color[2] += patch[row, column, 2]
    color /= middle[0]
    return color, color - middle @ plane / middle[0]


@njit(cache=True, nogil=True, fastmath=True)
def _unmixed(patch, plane, weights, where):  # type: ignore[no-untyped-def]
    """Alpha = (pixel - background) @ weights where asked, else 0, (h, w)."""
    by_b, by_g, by_r = weights[0], weights[1], weights[2]
    constant, along_u, along_v = plane @ weights
    alpha = np.zeros(patch.shape[:2])
    for row in range(patch.shape[0]):
        for column in range(patch.shape[1]):
            if not where[row, column]:
                continue
            x = by_b * patch[row, column, 0] + by_g * patch[row, column, 1] + by_r * patch[row, column, 2]
            alpha[row, column] = x - constant - along_u * column - along_v * row
    return alpha


@njit(cache=True, nogil=True, fastmath=True)
def _filled(alpha, near, core):  # type: ignore[no-untyped-def]
    """Make alpha 1 in the core and 0 away from the mark; its area and its centre of gravity."""
    area = sum_u = sum_v = 0.0
    for row in range(alpha.shape[0]):
        for column in range(alpha.shape[1]):
            if core[row, column]:
                alpha[row, column] = 1.0
            elif not near[row, column]:
                alpha[row, column] = 0.0
            area += alpha[row, column]
            sum_u += alpha[row, column] * column
            sum_v += alpha[row, column] * row
    return area, sum_u / area, sum_v / area


@njit(cache=True, nogil=True, fastmath=True)
def _arms(edge, area, u, v):  # type: ignore[no-untyped-def]
    """Sensitivity of the centre to the pixels of the edge.

    Returns the length of d center / d alpha of each, (h, w), the sum of its products with itself, (2, 2), and with
    (1, column, row), (2, 3).

    d center / d alpha = (place - center) / area, for the pixels whose alpha was measured
    """
    lengths = np.zeros(edge.shape)
    uu = uv = vv = du_sum = dv_sum = 0.0
    for row in range(edge.shape[0]):
        for column in range(edge.shape[1]):
            if edge[row, column]:
                du, dv = (column - u) / area, (row - v) / area
                lengths[row, column] = np.sqrt(du * du + dv * dv)
                du_sum += du
                dv_sum += dv
                uu += du * du
                uv += du * dv
                vv += dv * dv
    by_plane = np.empty((2, 3))
    by_plane[0, 0], by_plane[0, 1], by_plane[0, 2] = du_sum, u * du_sum + area * uu, v * du_sum + area * uv
    by_plane[1, 0], by_plane[1, 1], by_plane[1, 2] = dv_sum, u * dv_sum + area * uv, v * dv_sum + area * vv
    return lengths, np.array([[uu, uv], [uv, vv]]), by_plane


@njit(cache=True, nogil=True, fastmath=True)
def covered(patch, component, others, discs, settings, fit_pixels, thorough):  # type: ignore[no-untyped-def]
    """The coverage of a patch by a component: whether it is valid, alpha (h, w) with 0 away from it, and its figures.

    patch: (h, w, 3) uint8 BGR; component, others: 0 and 1, (h, w) uint8
    discs: half widths row by row of the disc that the mark may grow by and of that its core shrinks by, two arrays
    settings: outlier_sds, the lag up to which noise is correlated [px], edge_gain, floor_px2
    fit_pixels: pixels that the background is fitted to
    thorough: whether to measure the correlation of the noise; if not, the covariance is rough
    Figures: centre u, v, its covariance uu uv vv, area, noise of alpha, colour b g r.
    """
    outlier_sds, lag, edge_gain, floor_px2 = settings
    one = np.uint8(1)
    near = _grown(component, discs[0])
    core = one - _grown(one - component, discs[1])
    ring = (one - near) * (one - others)
    figures = np.zeros(10)
    there, plane, gram_inv, noise_cov = _background(patch, ring, outlier_sds, fit_pixels)
    if not there:
        return False, np.zeros(ring.shape), figures
    color, contrast = _contrast(patch, core if core.sum() >= 9 else component, plane)
    # Best linear unbiased estimate of alpha where pixel = background + alpha contrast + noise, noise ~ (0, N):
    # alpha = d' N^-1 (pixel - background) / d' N^-1 d
    weights = np.linalg.inv(noise_cov) @ contrast
    strength = weights @ contrast
    if not strength > 0:
        return False, np.zeros(ring.shape), figures
    edge = near & (one - core)
    measured = _unmixed(patch, plane, weights / strength, np.ones_like(near) if thorough else edge)
    alpha = measured.copy() if thorough else measured
    area, u, v = _filled(alpha, near, core)
    if not area > 0:
        return False, alpha, figures
    # Noise is weighted by its effect on the centre: compression leaves most of it at the mark's edge.
    leverage, arms, by_plane = _arms(edge, area, u, v)
    # Noise averaged over squares of lag + 1 pixels: its autocovariance, up to this lag, sums to (lag + 1)² variances.
    behind = at_edge = (lag + 1) ** 2 / strength
    if thorough:
        behind = _power(measured, ring.astype(np.float64), 2 * lag + 1)
        at_edge = edge_gain * _power(_lopsided(measured, leverage, u, v), leverage, lag)
    # Errors of the background's plane reach the centre too; they come from the noise of its fit.
    through = gram_inv @ np.ascontiguousarray(by_plane.T)
    cov = max(behind, at_edge) * arms + behind * by_plane @ through + floor_px2 * np.eye(2)
    figures[0], figures[1] = u, v
    figures[2], figures[3], figures[4] = cov[0, 0], cov[0, 1], cov[1, 1]
    figures[5], figures[6] = area, 1.0 / np.sqrt(strength)
    for c in range(3):
        figures[7 + c] = color[c]
    return True, alpha, figures


@njit(cache=True, nogil=True)
def _without_gaps(piece):  # type: ignore[no-untyped-def]
    """Whether the pixels of a piece are contiguous in each row, so that it has no holes."""
    for row in range(piece.shape[0]):
        runs = 0
        for column in range(1, piece.shape[1]):
            runs += piece[row, column] > piece[row, column - 1]
        if runs > 1:
            return False
    return True


@njit(cache=True, nogil=True)
def _only_piece(classes, number, fewest):  # type: ignore[no-untyped-def]
    """Whether a class has one piece of enough pixels, others negligible; the piece, (h, w); its rows and columns.

    Pixels are connected by sides and corners; holes count as part of the piece. It must not touch the rim.
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
            while met < n:  # the stack keeps all visited pixels: the piece
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
    # from the rim inward: pixels not reached are holes
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
    """Whether the class occurs on every other pixel of every other row, and a box around these pixels."""
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
    if high_v < 0:
        return False, box
    low = max(low_u - NARROW_PX, left), max(low_v - NARROW_PX, top)
    high = min(high_u + NARROW_PX + 1, right), min(high_v + NARROW_PX + 1, bottom)
    return True, (low[0], low[1], high[0], high[1])


@njit(cache=True, nogil=True)
def alone(frame, box, number, palette, fewest, pads, discs, settings, fit_pixels):  # type: ignore[no-untyped-def]
    """The single mark of a class in part of a picture: whether there is exactly one; corner, alpha and figures.

    frame: (h, w, 3) uint8; box: left, top, right, bottom; number: of the class
    palette: table, least values and least saturations as `classify` has them
    fewest: pixels of a mark at least; pads: px around it, and 1 / that of its longer side besides
    discs, settings, fit_pixels: as in `covered`, which gives alpha and figures, relative to the corner (u, v)
    """
    there, box = _narrowed(frame, box, number, palette)
    none = np.zeros((1, 1))
    if not there:
        return False, 0, 0, none, np.zeros(10)
    height, width = box[3] - box[1], box[2] - box[0]
    classes = np.empty((height, width), dtype=np.uint8)
    # not smoothed: where noise breaks a mark into pieces, the slow path finds more
    classify(frame[box[1] : box[3], box[0] : box[2]], palette[0], palette[1], palette[2], classes)
    there, piece, (low_v, high_v, low_u, high_u) = _only_piece(classes, number, fewest)
    if not there:
        return False, 0, 0, none, np.zeros(10)
    pad = pads[0] + max(high_v - low_v + 1, high_u - low_u + 1) // pads[1]
    v0, u0 = max(low_v - pad, 0), max(low_u - pad, 0)
    v1, u1 = min(high_v + 1 + pad, height), min(high_u + 1 + pad, width)
    patch = frame[box[1] + v0 : box[1] + v1, box[0] + u0 : box[0] + u1].copy()
    component = piece[v0:v1, u0:u1].copy()
    thorough = np.bool_(False)  # not a literal: one type for a choice made at run time, so that it is compiled once
    others = np.zeros_like(component)
    valid, alpha, figures = covered(patch, component, others, discs, settings, fit_pixels, thorough)
    return valid, box[0] + u0, box[1] + v0, alpha, figures
