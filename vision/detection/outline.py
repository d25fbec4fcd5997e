"""Outline of a mark, which determines its centre if a needle or a hand covers part of it.

A mark's centre of gravity is its centre only if all of it is visible. The visible part of its outline determines the
centre if something covers the rest, less accurately for a shorter arc. Image axes: u right, v down, pixels.
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

    shape_px: matrix [px], shape (2, 2): the mark is center + shape_px @ unit disc
    size_sd: relative standard deviation of its size
    area_px: area of the whole mark [px], which follows from shape_px
    even: whether it has one colour; otherwise, as for a shaded ball, the rim is detected instead of the colour
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
    """A mark fitted to the edges of its visible part.

    center_px, cov_px2: the centre [px], (2,), and its covariance [px²], (2, 2)
    share: share of directions in which the mark's own edge is visible
    beyond: share of directions in which an edge lies outside it, for example of a smeared or merged mark
    size: its size relative to the outline's
    """

    center_px: Floats
    cov_px2: Floats
    share: float
    beyond: float
    size: float


def fit_outline(
    alpha: Floats, start_px: Floats, outline: Outline, settings: OutlineSettings = DETECTION.outline
) -> Fitted | None:
    """Fit the mark to its visible edge; None if too little of it is visible.

    alpha: share of each pixel that the mark covers, 0 far from it, (h, w); its first pixel is (0, 0)
    start_px: a point inside the visible part, (2,)
    settings: `reach` is the largest distance of an edge from that point [sizes]; farther edges are another mark's
    """
    u, v, uu, uv, vv, share, beyond, size = kernels.fitted(
        alpha, np.ascontiguousarray(start_px), outline.shape_px, outline.size_sd, settings.for_kernel()
    ).tolist()
    if share < settings.min_share:
        return None
    return Fitted(np.array([u, v]), np.array([[uu, uv], [uv, vv]]), share, beyond, size)
