"""Learning the hue of a kind of mark from a position in a picture."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike

from vision.arrays import Image, Picture
from vision.detection.hue import MarkHue, on_circle
from vision.detection.records import HueError
from vision.detection.settings import DETECTION, HUE_LEARNING, HueLearningSettings


def learn_hue(frame_bgr: Image, at_px: ArrayLike, settings: HueLearningSettings = HUE_LEARNING) -> MarkHue:
    """Learn the colour range of a kind of mark from one mark in a picture.

    frame_bgr: (height, width, 3) uint8; at_px: position of the mark u, v [px], (2,)

    Raises ValueError if the position is outside the picture. Raises HueError if the mark at the position is too small,
    too large or grey.
    """
    u, v = (round(float(x)) for x in np.reshape(at_px, 2))
    height, width = frame_bgr.shape[:2]
    if not (0 <= u < width and 0 <= v < height):
        raise ValueError(f"place: expected one inside {width} x {height} px, found {u}, {v}")
    smooth = cv2.GaussianBlur(frame_bgr, (0, 0), 1.5)
    inside = cv2.erode(_around(smooth, u, v, settings), np.ones((3, 3), np.uint8)).astype(bool)
    if inside.sum() < settings.min_pixels:
        raise HueError(
            f"place {u}, {v}: expected a mark of {settings.min_pixels} or more pixels alike, found {inside.sum()};"
            " point at the middle of a mark"
        )
    if inside.mean() > DETECTION.components.max_picture_share:
        raise HueError(f"place {u}, {v}: expected a mark, found {inside.mean():.0%} of the picture; point at a mark")
    hsv = cv2.cvtColor(smooth.astype(np.float32) / 255.0, cv2.COLOR_BGR2HSV)[inside]
    angles, saturation, value = np.deg2rad(hsv[:, 0]), hsv[:, 1], hsv[:, 2]
    middle = np.arctan2(np.sin(angles).mean(), np.cos(angles).mean())
    errors = np.angle(np.exp(1j * (angles - middle)))
    most = settings.sds * settings.min_width_deg
    weakest = np.percentile(saturation, 5.0), np.percentile(value, 5.0)
    if weakest[0] < 0.1:
        raise HueError(
            f"place {u}, {v}: expected a coloured mark, found grey (saturation {weakest[0]:.2f}); point at a mark"
        )
    return MarkHue(
        hue_deg=on_circle(float(np.degrees(middle))),
        half_width_deg=float(np.clip(settings.sds * np.degrees(errors.std()), settings.min_width_deg, most)),
        min_saturation=float(settings.paler * weakest[0]),
        min_value=float(settings.darker * weakest[1]),
        saturation=float(saturation.mean()),
        value=float(value.mean()),
    )


def _around(smooth: Picture, u: int, v: int, settings: HueLearningSettings) -> Picture:
    """Mask of the pixels that have the colour of pixel u, v and are connected with it: 1, else 0, (h, w).

    The distance between two colours does not depend on their brightness. Otsu's threshold divides the distances from
    the colour of pixel u, v in a window. The window grows until no pixel of the mask is on the window's border.
    """
    height, width = smooth.shape[:2]
    brightness = np.maximum(smooth.sum(axis=2, dtype=np.float32), 1.0)
    shares = smooth / brightness[:, :, None]
    # distances are relative to this colour's distance from grey, and clipped to it
    grey = max(float(np.linalg.norm(shares[v, u] - 1.0 / 3.0)), 1e-6)
    distances = cv2.convertScaleAbs(np.linalg.norm(shares - shares[v, u], axis=2), alpha=255.0 / grey)
    inside: Picture = np.zeros((height, width), dtype=np.uint8)
    for reach in (settings.window_px * 2**k for k in range(12)):
        u0, v0, u1, v1 = max(u - reach, 0), max(v - reach, 0), min(u + reach + 1, width), min(v + reach + 1, height)
        window = distances[v0:v1, u0:u1]
        parting, _ = cv2.threshold(window, 0, 1, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
        alike = np.asarray(window <= min(parting, 255.0 * settings.max_distance), dtype=np.uint8)
        _, parts = cv2.connectedComponents(alike)
        part = (parts == parts[v - v0, u - u0]) & (alike > 0)
        inside[:] = 0
        inside[v0:v1, u0:u1] = part
        rim = (part[0].any() and v0 > 0, part[-1].any() and v1 < height, part[:, 0].any() and u0 > 0)
        if not (any(rim) or (part[:, -1].any() and u1 < width)):
            break
    return inside
