"""Share of each pixel that a mark covers. The shares give the centre and the area of the mark."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vision.arrays import Floats, Picture
from vision.detection import kernels
from vision.detection.settings import DETECTION, CoverageSettings

FIT_PIXELS = 800
"""Largest number of pixels in the fit of the background, a linear model. More pixels would only take longer."""


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """Coverage of a patch by a mark, and the mark's centre.

    center_px, cov_px2: centre relative to the patch's first pixel [px], (2,), and its covariance [px²], (2, 2)
    area_px: area of the mark [px]
    alpha: share of each pixel that the mark covers, (h, w), 0 far from the mark
    noise_sd: standard deviation of alpha due to noise, measured in the background, where alpha should be 0
    color_bgr: colour of the mark's core
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
    """Measure the share of each pixel that a mark covers; None if the mark cannot be distinguished from the background.

    patch: part of a picture around the mark, (h, w, 3) BGR uint8
    component: 1 on the pixels of the mark's colour class, else 0, (h, w) uint8
    others: 1 on pixels of other marks of this class, else 0, (h, w) uint8; these pixels are not used as background
    thorough: whether to measure the correlation of the noise. Without it, the covariance is approximate.
    """
    grow = settings.grow_px + max(component.shape) // 16
    valid, alpha, figures = kernels.covered(patch, component, others, grow, settings.for_kernel(), FIT_PIXELS, thorough)
    if not valid:
        return None
    u, v, uu, uv, vv, area, noise_sd, *color = figures.tolist()
    return Coverage(np.array([u, v]), np.array([[uu, uv], [uv, vv]]), area, alpha, noise_sd, tuple(color))
