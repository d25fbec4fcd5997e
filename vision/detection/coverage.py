"""Coverage of pixels by a mark; the mark's centre, covariance and area follow from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vision.arrays import Floats, Picture
from vision.detection import kernels
from vision.detection.settings import DETECTION, CoverageSettings

FIT_PIXELS = 800
"""Largest number of pixels in the fit of the background, a plane with three parameters; more would only cost time."""


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """Coverage of a patch by a mark, with the mark's centre.

    center_px, cov_px2: centre relative to the patch's first pixel [px], (2,), and its covariance [px²], (2, 2)
    area_px: its area [px]
    alpha: share of each pixel that the mark covers, (h, w), 0 far from it
    noise_sd: noise of a pixel's alpha in the background, relative to the mark's contrast
    color_bgr: colour of its core
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
    """The coverage of a patch by a component; None if the component cannot be distinguished from the background.

    patch: (h, w, 3) BGR uint8
    component: 1 on the pixels of the mark as the search found them, else 0, (h, w) uint8
    others: nonzero on pixels of other marks of the class, which are not background, (h, w) uint8
    thorough: whether to measure the correlation of the noise; if not, the covariance is approximate
    """
    grow = settings.grow_px + max(component.shape) // 16
    valid, alpha, figures = kernels.covered(patch, component, others, grow, settings.for_kernel(), FIT_PIXELS, thorough)
    if not valid:
        return None
    u, v, uu, uv, vv, area, noise_sd, *color = figures.tolist()
    return Coverage(np.array([u, v]), np.array([[uu, uv], [uv, vv]]), area, alpha, noise_sd, tuple(color))
