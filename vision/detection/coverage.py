"""Coverage of pixels by a mark, and from it the mark's centre, area and the covariance of the centre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vision.arrays import Floats, Picture
from vision.detection import kernels
from vision.detection.settings import DETECTION, CoverageSettings

FIT_PIXELS = 800
"""Largest number of pixels for the fit of the background: it only saves time, since a plane has three numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """Coverage of a patch by a mark, with the mark's centre.

    center_px, cov_px2: its centre from the patch's first pixel [px], (2,), and the covariance of that [px²], (2, 2)
    area_px: [px]
    alpha: share of each pixel that the mark covers, (h, w), 0 away from it
    noise_sd: noise of one pixel's alpha behind the mark, a measure of contrast
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
    """The coverage of a patch by a component; None if it cannot be distinguished from the background.

    patch: (h, w, 3) BGR uint8
    component: 1 on the pixels of the mark as the search found them, else 0, (h, w) uint8
    others: nonzero on pixels of other marks of the class, which are not background, (h, w) uint8
    thorough: whether to measure the correlation of the noise; if not, the covariance is rough
    """
    grow = settings.grow_px + max(component.shape) // 16
    valid, alpha, figures = kernels.covered(patch, component, others, grow, settings.for_kernel(), FIT_PIXELS, thorough)
    if not valid:
        return None
    u, v, uu, uv, vv, area, noise_sd, *color = figures.tolist()
    return Coverage(np.array([u, v]), np.array([[uu, uv], [uv, vv]]), area, alpha, noise_sd, tuple(color))
