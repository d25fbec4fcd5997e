"""A mark seen in a picture.

Image axes: u right, v down, the centre of the first pixel is (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass

from vision.arrays import Floats


class HueError(ValueError):
    """A range of hues that cannot distinguish marks from the scene."""


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """One mark seen.

    center_px: its centre [px], shape (2,)
    cov_px2: covariance of that [px²], shape (2, 2), from the noise around the mark and its area
    area_px: what is seen of it [px]
    hue_deg: the hue of its class
    clipped: it touches the border of what was searched, so part of it was not seen
    occluded: something hides part of it, so its centre is that of its outline
    color_bgr: of its core [grey levels]
    size: by that of the outline it was searched with
    """

    center_px: Floats
    cov_px2: Floats
    area_px: float
    hue_deg: float
    clipped: bool
    occluded: bool = False
    color_bgr: tuple[float, ...] = (0.0, 0.0, 0.0)
    size: float = 1.0
