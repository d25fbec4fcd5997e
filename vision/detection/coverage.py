"""How much of each pixel a mark covers, and with that its centre, its area and the covariance of the centre."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from vision.arrays import Floats, Picture
from vision.detection import kernels

GROW_PX = 3
"""How far beyond the component the mark's blurred edge may reach; chosen for lenses up to 1.5 px blur."""
PAD_PX = GROW_PX + 5
"""Rim of pixels around the component that is looked at: its outer part shows what lies behind the mark."""
CORE_PX = 2
"""Pixels this far inside the component are all mark, whatever stripes or highlights they show."""
FLOOR_PX2 = 0.0025**2
"""Variance of a centre when nothing else is wrong: rounding to grey levels, shading; measured on drawn frames."""
ROUNDING = 1.0 / 12.0
"""Variance of rounding to whole grey levels."""
OUTLIER_SDS = 4.0
"""Pixels further off than this are no background but something else near the mark."""
FIT_PIXELS = 800
"""Pixels that the background is fitted to, at most: more cost time and gain nothing."""
GRAIN_REACH = 7
"""Square of lags over which noise behind a mark may hang together [px]: grain up to 1.5 px spread."""
LOCAL_GAIN = 1.6
"""Variance of noise to that of half the difference of two: 2 for white noise; measured on films of quality 95, whose
noise alternates from pixel to pixel."""
LOCAL_REACH = 3
"""The same for what is lopsided in a mark [px]: little, as its first moment is gone with the centre; measured."""


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """What a mark covers of a patch.

    center_px, cov_px2: its centre from the patch's first pixel [px], (2,), and the covariance of that [px²], (2, 2)
    area_px: [px]
    alpha: share of each pixel that the mark covers, (h, w), 0 away from it
    noise_sd: of one pixel's alpha behind the mark: what its contrast is worth
    color_bgr: of its core
    """

    center_px: Floats
    cov_px2: Floats
    area_px: float
    alpha: Floats
    noise_sd: float
    color_bgr: tuple[float, ...]


def measure_coverage(patch: Picture, component: Picture, others: Picture, *, thorough: bool = True) -> Coverage | None:
    """What a component covers of a patch; None where it cannot be told from what lies behind it.

    patch: (h, w, 3) BGR uint8
    component: 1 on the pixels of the mark as the search found them, else 0, (h, w) uint8
    others: not 0 on pixels of other marks of the class, which are no background, (h, w) uint8
    thorough: whether to see how far the noise hangs together; if not, the covariance is rough
    """
    discs = _half_widths(GROW_PX + max(component.shape) // 16), _half_widths(CORE_PX)
    told, alpha, figures = kernels.covered(patch, component, others, discs, CONSTANTS, thorough)
    return _cover(alpha, figures) if told else None


def measure_isolated(
    frame: Picture, box: tuple[int, int, int, int], number: int, palette: tuple[Any, ...], fewest: int
) -> tuple[tuple[int, int], Coverage] | None:
    """The corner [px] of a patch, and what the only mark of a class covers of it, in a part of a picture; else None.

    box: left, top, right, bottom; number: of the class; palette: as `kernels.alone` has it; fewest: pixels of a mark
    """
    discs = _half_widths(GROW_PX + min(box[2] - box[0], box[3] - box[1]) // 20), _half_widths(CORE_PX)
    told, left, top, alpha, figures = kernels.alone(frame, box, number, palette, fewest, PADS, discs, FEWER)
    return ((left, top), _cover(alpha, figures)) if told else None


def _cover(alpha: Floats, figures: Floats) -> Coverage:
    u, v, uu, uv, vv, area, noise_sd, *color = figures.tolist()
    return Coverage(np.array([u, v]), np.array([[uu, uv], [uv, vv]]), area, alpha, noise_sd, tuple(color))


@lru_cache(maxsize=64)
def _half_widths(radius: int) -> Picture:
    """Of a disc, row by row, (2 radius + 1,)."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return (disc.sum(axis=1).astype(np.int64) - 1) // 2


PADS = (PAD_PX, 8)
"""What is looked at around a piece: so many pixels, and an eighth of its longer side."""
CONSTANTS = (OUTLIER_SDS, FIT_PIXELS, ROUNDING, GRAIN_REACH, LOCAL_GAIN, LOCAL_REACH, FLOOR_PX2)
"""As the kernel takes them."""
FEWER = (OUTLIER_SDS, FIT_PIXELS // 2, ROUNDING, GRAIN_REACH, LOCAL_GAIN, LOCAL_REACH, FLOOR_PX2)
"""The same, of half as many pixels behind the mark, for a mark that is alone."""
