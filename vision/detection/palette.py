"""Colour classes of pixels, one for each kind of mark."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from vision.arrays import Floats, Picture
from vision.detection import kernels
from vision.detection.hue import MarkHue


@dataclass(frozen=True, slots=True, eq=False)
class Palette:
    """Colour classes in the form that `kernels.classify` needs. The classes have the numbers 1, 2, 3 ..."""

    table: Picture
    least_value: Floats
    least_saturation: Floats


@lru_cache(maxsize=16)
def palette_of(hues: tuple[MarkHue, ...]) -> Palette:
    """One class for each hue, in the given order. Where ranges overlap, the class with the nearest middle is chosen."""
    steps = 360.0 / kernels.HUE_STEPS * np.arange(kernels.HUE_STEPS)
    distances = np.array([np.abs((steps - hue.middle_deg + 180.0) % 360.0 - 180.0) for hue in hues])
    half_widths = np.array([hue.half_width_deg for hue in hues])[:, None]
    beyond = np.where(distances <= half_widths, distances, np.inf)
    table = np.where(np.isfinite(beyond.min(axis=0)), 1 + beyond.argmin(axis=0), 0).astype(np.uint8)
    values = [255.0 * hue.min_value for hue in hues]
    saturations = [256.0 * hue.min_saturation for hue in hues]
    least = [np.array([min(each), *each]) for each in (values, saturations)]
    return Palette(table, *least)


def equal(classes: Picture, number: int) -> Picture:
    """Mask of the pixels of class `number`: 1, else 0, (h, w) uint8."""
    return np.asarray(classes == number, dtype=np.uint8)


def classes_of(part: Picture, palette: Palette, scale: int) -> Picture:
    """Class of each pixel, (h, w), after smoothing if scale is 1, otherwise after reduction by the factor scale."""
    if scale == 1:
        smooth = cv2.blur(part, (3, 3))
    else:
        height, width = (n // scale for n in part.shape[:2])
        whole = part[: height * scale, : width * scale]
        smooth = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    classes = np.empty(smooth.shape[:2], dtype=np.uint8)
    kernels.classify(smooth, palette.table, palette.least_value, palette.least_saturation, classes)
    return classes
