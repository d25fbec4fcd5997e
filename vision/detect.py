"""Marks in a frame: found by hue, placed between the pixels by how much of each pixel the mark covers.

Image axes: u right, v down, the centre of the first pixel is (0, 0).

A pixel at a mark's edge shows the mark over a share alpha of it and what lies behind over the rest. Where the colour of
both is known, alpha is a linear function of the pixel; its centre of gravity has no bias from any threshold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.coverage import PAD_PX, Picture, cover
from vision.hues import MarkHue

Floats = NDArray[np.float64]
Image = NDArray[np.uint8]

LARGEST_SHARE = 0.3
"""A range of hues that takes more of the picture than this shows the scene, not marks; chosen."""
MAX_ELONGATION = 4.0
"""Longest to shortest axis of what may be a mark: round marks smeared by up to three times their width; chosen."""
SEARCH_SHARE = 0.4
"""A mark may show this share of its least area in the search already; its edge counts only after that; chosen."""


class HueError(ValueError):
    """A range of hues that cannot tell marks from the scene."""


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """One mark seen.

    center_px: its centre [px], shape (2,)
    cov_px2: covariance of that [px²], shape (2, 2), from the noise around the mark and its area
    area_px: what it covers [px]
    hue_deg: the hue of its class
    clipped: it touches the border of what was searched, so part of it was not seen
    """

    center_px: Floats
    cov_px2: Floats
    area_px: float
    hue_deg: float
    clipped: bool


def detect_marks(
    frame_bgr: Image,
    hues: Sequence[MarkHue],
    *,
    min_area_px: float,
    max_area_px: float | None = None,
    region: tuple[int, int, int, int] | None = None,
) -> list[Detection]:
    """Marks of these hues, largest first.

    frame_bgr: shape (height, width, 3), uint8
    min_area_px, max_area_px: least and largest area of a mark [px]
    region: left, top, width, height of the part to search [px]; all of the frame where None

    Raises ValueError for a picture or region of another kind, HueError where a hue takes most of the picture.
    """
    if not isinstance(frame_bgr, np.ndarray) or frame_bgr.dtype != np.uint8 or frame_bgr.shape[2:] != (3,):
        kind = f"{getattr(frame_bgr, 'dtype', type(frame_bgr).__name__)} {np.shape(frame_bgr)}"
        raise ValueError(f"frame: expected uint8 (height, width, 3), found {kind}")
    left, top = (0, 0) if region is None else region[:2]
    part = frame_bgr if region is None else _cut(frame_bgr, region)
    # Smoothed for the search only: noise splits small marks. The centre comes from the pixels as they are.
    hsv = cv2.cvtColor(cv2.blur(part, (3, 3)), cv2.COLOR_BGR2HSV)
    found: list[Detection] = []
    for hue, ranges in zip(hues, _hue_ranges(hues), strict=True):
        mask = _pixels_of(hsv, hue, ranges)
        share = cv2.countNonZero(mask) / mask.size
        if share > LARGEST_SHARE:
            raise HueError(
                f"hue {hue.hue_deg:g} ± {hue.half_width_deg:g} degrees: expected marks on up to {LARGEST_SHARE:.0%} "
                f"of the picture, found {share:.0%}; narrow the range or raise min_saturation ({hue.min_saturation:g})"
            )
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        for contour in contours:
            detection = _detected(part, mask, contour, hue.hue_deg, min_area_px)
            if detection is not None and detection.area_px <= (max_area_px or np.inf):
                found.append(detection)
    placed = [Detection(d.center_px + np.array([left, top]), d.cov_px2, d.area_px, d.hue_deg, d.clipped) for d in found]
    return sorted(placed, key=lambda detection: -detection.area_px)


def _cut(frame: Image, region: tuple[int, int, int, int]) -> Image:
    left, top, width, height = region
    if left < 0 or top < 0 or min(width, height) < 1 or left + width > frame.shape[1] or top + height > frame.shape[0]:
        raise ValueError(
            f"region: expected left, top, width, height inside {frame.shape[1]} x {frame.shape[0]} px, found {region}"
        )
    return frame[top : top + height, left : left + width]


def _hue_ranges(hues: Sequence[MarkHue]) -> list[list[tuple[int, int]]]:
    """For each class the runs of OpenCV's hue levels (0 to 179, 2 degrees each) that are nearest to it."""
    levels = 2.0 * np.arange(180)
    distances = np.array([np.abs((levels - h.hue_deg + 180.0) % 360.0 - 180.0) for h in hues]).reshape(-1, 180)
    ranges = []
    for k, hue in enumerate(hues):
        mine = (distances[k] <= hue.half_width_deg) & (distances[:k] > distances[k]).all(axis=0)
        mine &= (distances[k + 1 :] >= distances[k]).all(axis=0)
        steps = np.flatnonzero(np.diff(np.concatenate([[0], mine.astype(int), [0]])))
        ranges.append([(int(a), int(b) - 1) for a, b in steps.reshape(-1, 2)])
    return ranges


def _pixels_of(hsv: Picture, hue: MarkHue, ranges: list[tuple[int, int]]) -> Picture:
    saturation, value = 255.0 * hue.min_saturation, 255.0 * hue.min_value
    mask: Picture = np.zeros(hsv.shape[:2], dtype=np.uint8)
    # Red lies on both ends of OpenCV's circle: two runs.
    for k, (first, last) in enumerate(ranges):
        run = cv2.inRange(hsv, (first, saturation, value), (last, 255, 255))
        mask = run if k == 0 else cv2.bitwise_or(mask, run)
    return mask


def _detected(frame: Picture, mask: Picture, contour: Picture, hue_deg: float, min_area_px: float) -> Detection | None:
    """The mark inside this contour of the mask; None where it is too small or too long to be one."""
    if len(contour) < 2 and min_area_px > 1.0 / SEARCH_SHARE:
        return None
    u, v, width, height = cv2.boundingRect(contour)
    if width * height < SEARCH_SHARE * min_area_px:
        return None
    frame_height, frame_width = frame.shape[:2]
    pad = PAD_PX + max(width, height) // 8
    u0, v0 = max(u - pad, 0), max(v - pad, 0)
    u1, v1 = min(u + width + pad, frame_width), min(v + height + pad, frame_height)
    component = np.zeros((v1 - v0, u1 - u0), dtype=np.uint8)
    cv2.drawContours(component, [contour], -1, 1, cv2.FILLED, offset=(-u0, -v0))
    if cv2.countNonZero(component) < SEARCH_SHARE * min_area_px or _elongation(component) > MAX_ELONGATION:
        return None
    others = mask[v0:v1, u0:u1] & (1 - component)
    covered = cover(frame[v0:v1, u0:u1], component, cv2.dilate(others, np.ones((5, 5), np.uint8)))
    if covered is None or covered.area_px < min_area_px:
        return None
    clipped = u == 0 or v == 0 or u + width == frame_width or v + height == frame_height
    # Of a mark that the border cuts, as much again as is seen may lie outside.
    outside = (max(width, height) / 2.0) ** 2 if clipped else 0.0
    center = covered.center_px + np.array([u0, v0])
    return Detection(center, covered.cov_px2 + outside * np.eye(2), covered.area_px, hue_deg, clipped)


def _elongation(component: Picture) -> float:
    m = cv2.moments(component, binaryImage=True)
    uu, vv, uv = m["mu20"] / m["m00"], m["mu02"] / m["m00"], m["mu11"] / m["m00"]
    # A pixel is no point: a row of pixels still has the width of one (1/12 px²).
    mean, half = (uu + vv) / 2.0 + 1.0 / 12.0, np.hypot((uu - vv) / 2.0, uv)
    return float(np.sqrt((mean + half) / (mean - half)))
