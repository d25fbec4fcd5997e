"""Outline of a mark. The visible part of the outline gives the centre of a partly covered mark.

If a needle or a hand covers part of a mark, the centre of gravity of the visible pixels is not the mark's centre. The
longer the visible part of the outline, the more accurate is the centre. Image axes: u right, v down, in pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, pi

import numpy as np

from vision.arrays import Floats
from vision.detection import kernels
from vision.detection.settings import DETECTION, OutlineSettings


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Shape and size of a whole mark in a picture.

    shape_px: matrix that maps the unit disc to the mark, relative to the mark's centre [px], shape (2, 2)
    size_sd: relative standard deviation of the mark's size
    area_px: area of the whole mark, computed from shape_px [px]
    even: whether the mark has one colour. A mark without one colour, such as a shaded ball, is detected by its rim.
    """

    shape_px: Floats
    size_sd: float = 0.1
    even: bool = True
    area_px: float = field(init=False)

    def __post_init__(self) -> None:
        shape = np.array(self.shape_px, dtype=np.float64, order="C")
        (a, b), (c, d) = shape.tolist() if shape.shape == (2, 2) else ((0.0, 0.0), (0.0, 0.0))
        area = pi * abs(a * d - b * c)
        if not 0.0 < area < inf:
            raise ValueError(f"outline shape_px: expected an invertible (2, 2), found {shape.tolist()}")
        if not self.size_sd > 0:
            raise ValueError(f"outline size_sd: expected more than 0, found {self.size_sd}")
        object.__setattr__(self, "shape_px", shape)
        object.__setattr__(self, "area_px", area)


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """An outline fitted to the edge points of a mark. Each ray from the mark's middle has at most one edge point.

    center_px, cov_px2: the outline's centre [px], (2,), and the covariance of this centre [px²], (2, 2)
    share: share of the rays whose edge point lies on the fitted outline
    beyond: share of the rays whose edge point lies outside the fitted outline. The cause may be blood or another mark
        that touches the mark.
    size: size of the fitted outline, relative to the given outline
    """

    center_px: Floats
    cov_px2: Floats
    share: float
    beyond: float
    size: float


def fit_outline(
    alpha: Floats, start_px: Floats, outline: Outline, settings: OutlineSettings = DETECTION.outline
) -> Fitted | None:
    """Fit an outline to the visible edge of a mark; None if too little of the edge is visible.

    alpha: share of each pixel that the mark covers, 0 far from the mark, (h, w)
    start_px: a point inside the visible part, relative to the first pixel of alpha [px], (2,)
    """
    u, v, uu, uv, vv, share, beyond, size = kernels.fitted(
        alpha, np.ascontiguousarray(start_px), outline.shape_px, outline.size_sd, settings.for_kernel()
    ).tolist()
    if share < settings.min_share:
        return None
    return Fitted(np.array([u, v]), np.array([[uu, uv], [uv, vv]]), share, beyond, size)
