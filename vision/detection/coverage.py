"""The share of each pixel that a mark covers, and from that its centre, its area and the covariance of the centre."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from vision.arrays import Floats, Picture
from vision.detection import kernels
from vision.detection.settings import DETECTION, CoverageSettings

FIT_PIXELS = 800
"""Most pixels for the fit of the background: it only saves time, a plane of three numbers needs no more."""


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """The coverage of a patch by a mark.

    center_px, cov_px2: its centre from the patch's first pixel [px], (2,), and the covariance of that [px²], (2, 2)
    area_px: [px]
    alpha: share of each pixel that the mark covers, (h, w), 0 away from it
    noise_sd: noise of one pixel's alpha behind the mark, which measures the contrast
    color_bgr: of its core
    """

    center_px: Floats
    cov_px2: Floats
    area_px: float
    alpha: Floats
    noise_sd: float
    color_bgr: tuple[float, ...]


def measure_coverage(
    patch: Picture,
    component: Picture,
    others: Picture,
    settings: CoverageSettings = DETECTION.coverage,
    *,
    thorough: bool = True,
) -> Coverage | None:
    """The coverage of a patch by a component; None where it cannot be distinguished from the background.

    patch: (h, w, 3) BGR uint8
    component: 1 on the pixels of the mark as the search found them, else 0, (h, w) uint8
    others: not 0 on pixels of other marks of the class, which are not background, (h, w) uint8
    thorough: whether to measure the correlation of the noise; if not, the covariance is rough
    """
    discs = _half_widths(settings.grow_px + max(component.shape) // 16), _half_widths(settings.core_px)
    valid, alpha, figures = kernels.covered(
        patch, component, others, discs, settings.for_kernel(), FIT_PIXELS, thorough
    )
    return _cover(alpha, figures) if valid else None


def measure_isolated(
    frame: Picture,
    box: tuple[int, int, int, int],
    classes: tuple[int, tuple[Any, ...]],
    fewest: int,
    settings: CoverageSettings = DETECTION.coverage,
) -> tuple[tuple[int, int], Coverage] | None:
    """The corner [px] of a patch, and its coverage by the single mark of a class in a box; None otherwise.

    box: left, top, right, bottom; classes: number of the class, and the palette as `kernels.alone` has it
    fewest: pixels of a mark
    """
    discs = (
        _half_widths(settings.grow_px + min(box[2] - box[0], box[3] - box[1]) // 20),
        _half_widths(settings.core_px),
    )
    valid, left, top, alpha, figures = kernels.alone(
        frame, box, *classes, fewest, (settings.pad_px, 8), discs, settings.for_kernel(), FIT_PIXELS // 2
    )
    return ((left, top), _cover(alpha, figures)) if valid else None


def _cover(alpha: Floats, figures: Floats) -> Coverage:
    u, v, uu, uv, vv, area, noise_sd, *color = figures.tolist()
    return Coverage(np.array([u, v]), np.array([[uu, uv], [uv, vv]]), area, alpha, noise_sd, tuple(color))


@lru_cache(maxsize=64)
def _half_widths(radius: int) -> Picture:
    """Half widths of a disc, row by row, (2 radius + 1,)."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return (disc.sum(axis=1).astype(np.int64) - 1) // 2
