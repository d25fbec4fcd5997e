"""Layers of a drawn scene. A layer has a colour, a position in the picture, and the share of each pixel that it covers.

A colour is the share of light that the object reflects, linear, in BGR order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vision.arrays import Picture


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """An object that covers part of the picture.

    left, top: position of the first element of alpha in the picture [px]; it may lie outside the picture
    alpha: the share of each pixel that the object covers, 0 to 1, shape (n_rows, n_columns)
    color_bgr: colour of the object, shape (3,), or of each of its pixels, shape (n_rows, n_columns, 3)
    """

    left: int
    top: int
    alpha: Picture
    color_bgr: Picture

    def __post_init__(self) -> None:
        if self.alpha.ndim != 2 or self.color_bgr.shape not in {(3,), (*self.alpha.shape, 3)}:
            raise ValueError(
                f"layer: expected alpha (n_rows, n_columns) and its colours, "
                f"found {self.alpha.shape} and {self.color_bgr.shape}"
            )


def paint(picture: Picture, layer: Layer) -> None:
    """Draw a layer over a picture, (height, width, 3); the picture is changed in place."""
    inside, own = _overlap(picture.shape[:2], layer)
    part, alpha = picture[inside], layer.alpha[own].astype(np.float32)[:, :, None]
    color = layer.color_bgr if layer.color_bgr.ndim == 1 else layer.color_bgr[own]
    part += alpha * (color.astype(np.float32) - part)


def take(free: Picture, layer: Layer) -> float:
    """Visible area of a layer [px]; free: share of each pixel that no layer covers yet, (h, w), updated in place."""
    inside, own = _overlap(free.shape, layer)
    part, alpha = free[inside], layer.alpha[own]
    seen = float((part * alpha).sum(dtype=np.float64))
    part *= 1.0 - alpha
    return seen


def _overlap(shape: ArrayLike, layer: Layer) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Rows and columns of the part of a layer inside the picture: slices of the picture, and slices of the layer."""
    inside, own = [], []
    for start, length, size in zip((layer.top, layer.left), layer.alpha.shape, np.asarray(shape), strict=True):
        low, high = max(start, 0), min(start + length, int(size))
        high = max(low, high)
        inside.append(slice(low, high))
        own.append(slice(low - start, high - start))
    return (inside[0], inside[1]), (own[0], own[1])
