"""Detection of the rim (outline) of a mark without uniform colour, such as a ball with shading or a highlight.

If the colour varies over the mark, the share of each pixel that the mark covers cannot be estimated. But colour changes
in a step at the outline. Image axes: u right, v down, in pixels.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.arrays import Floats
from vision.detection.kernels import N_RAYS
from vision.detection.outline import Fitted, Outline
from vision.detection.settings import DETECTION, DetectionSettings

N_STEPS = 3
"""Number of colour steps stored for each ray. Several are stored, because not only the rim causes steps."""


def fit_rim(
    patch_bgr: NDArray[np.uint8], starts: Floats, outline: Outline, settings: DetectionSettings = DETECTION
) -> Fitted | None:
    """Fit an outline to steps of colour, from several starts. Returns the best fit; None if no fit has enough steps.

    patch_bgr: (h, w, 3)
    starts: initial values of the fit, (n, 3): centre u v in the patch [px], and size relative to the given outline [1]
    """
    rim, edge = settings.rim, settings.outline
    limits = rim.wide, rim.narrow_px, edge.correlation_px, edge.edge_sd_px
    smooth = cv2.GaussianBlur(patch_bgr, (0, 0), rim.blur_px).astype(np.float64)
    steps = _steps(smooth, starts[0, :2].copy(), outline.shape_px, (1.0 - rim.around, 1.0 + rim.around, rim.min_step))
    inverse = np.linalg.inv(outline.shape_px)
    best: tuple[float, Fitted] | None = None
    for start in starts:
        begin = np.array([*(inverse @ (start[:2] - starts[0, :2])), start[2]])
        score, fit, cov, share = _settled(steps, begin, outline.size_sd, _scale(outline), limits)
        if share >= edge.min_share and (best is None or score > best[0]):
            center = starts[0, :2] + outline.shape_px @ fit[:2]
            best = score, Fitted(center, outline.shape_px @ cov @ outline.shape_px.T, share, 0.0, float(fit[2]))
    return None if best is None else best[1]


def _scale(outline: Outline) -> float:
    return float((outline.area_px / np.pi) ** 0.5)


@njit(cache=True, nogil=True, fastmath=True)
def _steps(smooth, start, shape, settings):  # type: ignore[no-untyped-def]
    """Highest colour steps on each ray, (N_RAYS, N_STEPS, 3): x, y from `start` [sizes], and height [grey levels]."""
    low, high, min_step = settings
    height, width = smooth.shape[:2]
    scale = np.sqrt(abs(shape[0, 0] * shape[1, 1] - shape[0, 1] * shape[1, 0]))
    pixel = 1.0 / scale
    n = int((high - low) * scale * 2.0) + 1
    steps = np.zeros((N_RAYS, N_STEPS, 3))
    values, heights = np.empty((n + 4, 3)), np.empty(n)
    for k in range(N_RAYS):
        angle = 2.0 * np.pi * k / N_RAYS
        x, y = np.cos(angle), np.sin(angle)
        along_u, along_v = shape[0, 0] * x + shape[0, 1] * y, shape[1, 0] * x + shape[1, 1] * y
        last = n + 4
        for i in range(n + 4):
            t = low + 0.5 * pixel * (i - 2)
            u, v = start[0] + t * along_u, start[1] + t * along_v
            if not (0.0 <= u < width - 1 and 0.0 <= v < height - 1):
                last = i
                break
            row, column = int(v), int(u)
            a, b = v - row, u - column
            for c in range(3):
                upper = (1.0 - b) * smooth[row, column, c] + b * smooth[row, column + 1, c]
                lower = (1.0 - b) * smooth[row + 1, column, c] + b * smooth[row + 1, column + 1, c]
                values[i, c] = (1.0 - a) * upper + a * lower
        n_here = max(last - 4, 0)
        for i in range(n_here):
            heights[i] = 0.0
            for c in range(3):
                heights[i] += abs(values[i + 4, c] - values[i, c])
        for i in range(1, n_here - 1):
            if heights[i] < min_step or heights[i] < heights[i - 1] or heights[i] <= heights[i + 1]:
                continue
            bend = heights[i - 1] - 2.0 * heights[i] + heights[i + 1]
            shift = 0.0 if bend == 0.0 else 0.5 * (heights[i - 1] - heights[i + 1]) / bend
            weakest = 0
            for j in range(1, N_STEPS):
                if steps[k, j, 2] < steps[k, weakest, 2]:
                    weakest = j
            if heights[i] > steps[k, weakest, 2]:
                t = low + 0.5 * pixel * (i + shift)
                steps[k, weakest, 0], steps[k, weakest, 1], steps[k, weakest, 2] = t * x, t * y, heights[i]
    return steps


@njit(cache=True, nogil=True, fastmath=True)
def _settled(steps, begin, size_sd, scale, limits):  # type: ignore[no-untyped-def]
    """Fit a circle to colour steps, at most one on each ray.

    Returns the sum of the steps' weights, the circle (x, y, size), the covariance of x and y, and sum / N_RAYS.
    """
    wide, narrow_px, correlation_px, edge_sd_px = limits
    fit, normal, gradient = begin.copy(), np.zeros((3, 3)), np.zeros(3)
    limit, narrowest = wide, narrow_px / scale
    variance, score, n_on = narrowest**2, 0.0, 0.0
    strong = 0.0
    for k in range(N_RAYS):
        strong += max(steps[k, 0, 2], steps[k, 1, 2], steps[k, 2, 2]) / N_RAYS
    for _ in range(14):
        normal[:] = 0.0
        weight = variance / size_sd**2
        normal[2, 2] = weight
        gradient[0], gradient[1], gradient[2] = 0.0, 0.0, weight * (1.0 - fit[2])
        score = n_on = squares = 0.0
        for k in range(N_RAYS):
            nearest, error, own_x, own_y = 2.0 * limit, 0.0, 0.0, 0.0
            height = 0.0
            for j in range(N_STEPS):
                if steps[k, j, 2] == 0.0:
                    continue
                x, y = steps[k, j, 0] - fit[0], steps[k, j, 1] - fit[1]
                length = np.sqrt(x * x + y * y)
                # a weak step must be nearer to the circle to be used
                there = abs(length - fit[2]) * (1.0 + strong / (steps[k, j, 2] + strong))
                if there < nearest:
                    nearest, error, height = there, length - fit[2], steps[k, j, 2]
                    own_x, own_y = x / length, y / length
            if abs(error) >= limit or height == 0.0:
                continue
            w = (1.0 - (error / limit) ** 2) ** 2 * height / (height + 0.5 * strong)
            slope = np.array([own_x, own_y, 1.0])
            for a in range(3):
                gradient[a] += w * error * slope[a]
                for b in range(3):
                    normal[a, b] += w * slope[a] * slope[b]
            squares += w * error * error
            n_on += w
            score += w
        if n_on < 3.0 or abs(np.linalg.det(normal)) < 1e-9:
            return 0.0, fit, np.eye(2), 0.0
        fit += np.linalg.inv(normal) @ gradient
        variance = max(squares / n_on, (edge_sd_px / scale) ** 2)
        limit = max(0.75 * limit, narrowest)
    share = n_on / N_RAYS
    together = max(1.0, correlation_px * N_RAYS / (2.0 * np.pi * scale * fit[2])) / share
    return score, fit, variance * together * np.ascontiguousarray(np.linalg.inv(normal)[:2, :2]), share
