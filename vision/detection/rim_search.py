"""Detection of a mark by its rim alone, for example if blood of the mark's colour touches the mark."""

from __future__ import annotations

import cv2
import numpy as np

from vision.arrays import Image
from vision.detection.expected import Expected
from vision.detection.records import Detection
from vision.detection.rim import fit_rim
from vision.detection.settings import DETECTION, DetectionSettings


def detect_by_rim(frame_bgr: Image, expected: Expected, settings: DetectionSettings = DETECTION) -> Detection | None:
    """A mark whose rim is visible near its expected position, or None. The caller must check the mark's colour.

    If the standard deviation of the expected position exceeds the mark's radius, the result is None.
    """
    outline = expected.outline
    if outline is None:
        return None
    radius = (outline.area_px / np.pi) ** 0.5
    sd = float(np.sqrt(np.trace(expected.cov_px2) / 2.0))
    if sd > radius:
        return None
    away = settings.centers.gate**0.5 * sd
    reach = int(np.ceil(2.0 * radius + away + 3.0))
    height, width = frame_bgr.shape[:2]
    u, v = (round(float(x)) for x in expected.center_px)
    u0, v0, u1, v1 = max(u - reach, 0), max(v - reach, 0), min(u + reach + 1, width), min(v + reach + 1, height)
    if u1 - u0 < 2 * radius or v1 - v0 < 2 * radius:
        return None
    patch = np.ascontiguousarray(frame_bgr[v0:v1, u0:u1])
    corner = np.array([u0, v0], dtype=float)
    steps = away * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    starts = np.array([(*(expected.center_px - corner + (du, dv)), 1.0) for du in steps for dv in steps])
    middle = starts[len(starts) // 2].copy()
    rim = fit_rim(patch, np.vstack([middle, starts]), outline, settings)
    if rim is None or rim.share < settings.rim.min_share_alone:
        return None
    mask = np.zeros(patch.shape[:2], dtype=np.uint8)
    center = rim.center_px
    cv2.circle(mask, (round(center[0]), round(center[1])), max(1, round(radius)), 1, cv2.FILLED)
    color = tuple(float(level) for level in cv2.mean(patch, mask)[:3])
    area = float(outline.area_px * rim.size**2)
    return Detection(center + corner, rim.cov_px2, area, expected.hue_deg, False, True, color, rim.size)
