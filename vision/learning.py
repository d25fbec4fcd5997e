"""The hue of a kind of mark, learned from a place in a picture that shows one."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.detect import LARGEST_SHARE, HueError
from vision.hues import MarkHue

Image = NDArray[np.uint8]

ALIKE = 0.5
"""By how much pixels of one mark may differ in the shares of colours, by what sets its middle off from grey; chosen."""
FEWEST_PIXELS = 12
SDS = 3.0
"""Standard deviations of its pixels' hues that a kind of mark reaches; chosen."""
NARROWEST_DEG, WIDEST_DEG = 8.0, 40.0
"""Half widths of a learned range; chosen."""
WEAKEST, WEAKER = 5.0, 0.6
"""Percentile of saturation and value that is still the mark's, and how much weaker later ones may be; chosen."""


def learn_hue(frame_bgr: Image, at_px: ArrayLike) -> MarkHue:
    """The kind of mark that covers this place, of the pixels around it that are coloured alike, bright or dark.

    frame_bgr: (height, width, 3) uint8; at_px: u, v [px], (2,)

    Raises ValueError for a place outside the picture, HueError where it shows no mark: too few pixels alike, too many,
    or grey ones.
    """
    u, v = (round(float(x)) for x in np.reshape(at_px, 2))
    height, width = frame_bgr.shape[:2]
    if not (0 <= u < width and 0 <= v < height):
        raise ValueError(f"place: expected one inside {width} x {height} px, found {u}, {v}")
    smooth = cv2.GaussianBlur(frame_bgr, (0, 0), 1.5)
    brightness = np.maximum(smooth.sum(axis=2, dtype=np.float32), 1.0)
    shares = (smooth / brightness[:, :, None]).astype(np.float32)
    mask = np.zeros((height + 2, width + 2), dtype=np.uint8)
    alike = (ALIKE * float(np.abs(shares[v, u] - 1.0 / 3.0).max()),) * 3
    cv2.floodFill(
        shares, mask, (u, v), (0.0, 0.0, 0.0), alike, alike, cv2.FLOODFILL_FIXED_RANGE | cv2.FLOODFILL_MASK_ONLY
    )
    inside = cv2.erode(mask[1:-1, 1:-1], np.ones((3, 3), np.uint8)).astype(bool)
    if inside.sum() < FEWEST_PIXELS:
        raise HueError(
            f"place {u}, {v}: expected a mark of {FEWEST_PIXELS} or more pixels alike, found {inside.sum()};"
            " point at the middle of a mark"
        )
    if inside.mean() > LARGEST_SHARE:
        raise HueError(f"place {u}, {v}: expected a mark, found {inside.mean():.0%} of the picture; point at a mark")
    hsv = cv2.cvtColor(smooth.astype(np.float32) / 255.0, cv2.COLOR_BGR2HSV)[inside]
    angles, saturation, value = np.deg2rad(hsv[:, 0]), hsv[:, 1], hsv[:, 2]
    middle = np.arctan2(np.sin(angles).mean(), np.cos(angles).mean())
    off = np.angle(np.exp(1j * (angles - middle)))
    weakest = np.percentile(saturation, WEAKEST), np.percentile(value, WEAKEST)
    if weakest[0] < 0.1:
        raise HueError(
            f"place {u}, {v}: expected a coloured mark, found grey (saturation {weakest[0]:.2f}); point at a mark"
        )
    return MarkHue(
        hue_deg=float(np.degrees(middle) % 360.0),
        half_width_deg=float(np.clip(SDS * np.degrees(off.std()), NARROWEST_DEG, WIDEST_DEG)),
        min_saturation=float(WEAKER * weakest[0]),
        min_value=float(WEAKER * weakest[1]),
    )
