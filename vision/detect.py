"""Marks in a frame: found by hue, placed between the pixels by how much of each pixel the mark covers.

Image axes: u right, v down, the centre of the first pixel is (0, 0).

A pixel at a mark's edge shows the mark over a share alpha of it and what lies behind over the rest. Where the colour of
both is known, alpha is a linear function of the pixel; its centre of gravity has no bias from any threshold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from vision import kernels
from vision.coverage import PAD_PX, Picture, cover
from vision.hues import MarkHue
from vision.outline import Outline, fit_outline

Floats = NDArray[np.float64]
Image = NDArray[np.uint8]

LARGEST_SHARE = 0.3
"""A range of hues that takes more of the picture than this shows the scene, not marks; chosen."""
MAX_ELONGATION = 4.0
"""Longest to shortest axis of what may be a mark: round marks smeared by up to three times their width; chosen."""
SEARCH_SHARE = 0.4
"""A mark may show this share of its least area in the search already; its edge counts only after that; chosen."""
COARSE_AREA_PX = 150.0
"""Marks of at least so many pixels are searched for in a picture of half the size; chosen."""
APART = 13.815510557964274
"""Squared distance beyond which two centres of one mark, by area and by outline, differ: chi-square, 0.1 %."""
BEYOND = 0.1
"""Where more than this share of the edge lies outside the outline, a mark is not covered but smeared; chosen."""
SQUARE_5 = np.ones((5, 5), np.uint8)
ONE_MARK = 0.5
"""Fragments whose outlines' centres are nearer than this share of its size are one mark; chosen."""


class HueError(ValueError):
    """A range of hues that cannot tell marks from the scene."""


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """One mark seen.

    center_px: its centre [px], shape (2,)
    cov_px2: covariance of that [px²], shape (2, 2), from the noise around the mark and its area
    area_px: what is seen of it [px]
    hue_deg: the hue of its class
    clipped: it touches the border of what was searched, so part of it was not seen
    covered: something hides part of it, so its centre is that of its outline
    color_bgr: of its core [grey levels]
    """

    center_px: Floats
    cov_px2: Floats
    area_px: float
    hue_deg: float
    clipped: bool
    covered: bool = False
    color_bgr: tuple[float, ...] = (0.0, 0.0, 0.0)


def detect_marks(
    frame_bgr: Image,
    hues: Sequence[MarkHue],
    *,
    min_area_px: float,
    max_area_px: float | None = None,
    region: tuple[int, int, int, int] | None = None,
    outline: Outline | None = None,
) -> list[Detection]:
    """Marks of these hues, largest first.

    frame_bgr: shape (height, width, 3), uint8
    min_area_px, max_area_px: least and largest area that is seen of a mark [px]
    region: left, top, width, height of the part to search [px]; all of the frame where None
    outline: what a whole mark looks like; with it, marks that are partly covered are found at their centre

    Raises ValueError for a picture or region of another kind, HueError where a hue takes most of the picture.
    """
    if not isinstance(frame_bgr, np.ndarray) or frame_bgr.dtype != np.uint8 or frame_bgr.shape[2:] != (3,):
        kind = f"{getattr(frame_bgr, 'dtype', type(frame_bgr).__name__)} {np.shape(frame_bgr)}"
        raise ValueError(f"frame: expected uint8 (height, width, 3), found {kind}")
    left, top = (0, 0) if region is None else region[:2]
    part = frame_bgr if region is None else _cut(frame_bgr, region)
    if not hues:
        return []
    palette = _palette(tuple(hues))
    scale = 2 if region is None and min_area_px >= COARSE_AREA_PX and min(part.shape[:2]) > 1 else 1
    classes = _classes(part, palette, scale)
    search = _Search(part, classes, palette, scale, min_area_px, max_area_px or np.inf, outline)
    found: list[Detection] = []
    for number, hue in enumerate(hues, start=1):
        mask = classes if len(hues) == 1 else _equal(classes, number)
        if region is None:
            _check_share(hue, cv2.countNonZero(mask) / mask.size)
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        of_hue = [d for contour in contours if (d := search.detected(contour, number, hue.hue_deg)) is not None]
        found += of_hue if outline is None else _pieced(of_hue, outline)
    placed = found if region is None else [replace(d, center_px=d.center_px + np.array([left, top])) for d in found]
    return sorted(placed, key=lambda detection: -detection.area_px)


def _cut(frame: Image, region: tuple[int, int, int, int]) -> Image:
    left, top, width, height = region
    if left < 0 or top < 0 or min(width, height) < 1 or left + width > frame.shape[1] or top + height > frame.shape[0]:
        raise ValueError(
            f"region: expected left, top, width, height inside {frame.shape[1]} x {frame.shape[0]} px, found {region}"
        )
    return frame[top : top + height, left : left + width]


def _check_share(hue: MarkHue, share: float) -> None:
    if share > LARGEST_SHARE:
        raise HueError(
            f"hue {hue.hue_deg:g} ± {hue.half_width_deg:g} degrees: expected marks on up to {LARGEST_SHARE:.0%} "
            f"of the picture, found {share:.0%}; narrow the range or raise min_saturation ({hue.min_saturation:g})"
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Palette:
    """Classes of colour as `kernels.classify` takes them, numbered from 1 in their order."""

    table: Picture
    least_value: Floats
    least_saturation: Floats


@lru_cache(maxsize=16)
def _palette(hues: tuple[MarkHue, ...]) -> _Palette:
    steps = 360.0 / kernels.HUE_STEPS * np.arange(kernels.HUE_STEPS)
    off = np.array([np.abs((steps - hue.middle_deg + 180.0) % 360.0 - 180.0) for hue in hues])
    half_widths = np.array([hue.half_width_deg for hue in hues])[:, None]
    beyond = np.where(off <= half_widths, off, np.inf)
    table = np.where(np.isfinite(beyond.min(axis=0)), 1 + beyond.argmin(axis=0), 0).astype(np.uint8)
    values = [255.0 * hue.min_value for hue in hues]
    saturations = [256.0 * hue.min_saturation for hue in hues]
    least = [np.array([min(each), *each]) for each in (values, saturations)]
    return _Palette(table, *least)


def _equal(classes: Picture, number: int) -> Picture:
    """1 where a pixel is of that class, else 0, (h, w) uint8."""
    return np.asarray(classes == number, dtype=np.uint8)


def _classes(part: Picture, palette: _Palette, scale: int) -> Picture:
    """The class of each pixel, smoothed or shrunk for the search only: noise splits small marks."""
    if scale == 1:
        smooth = cv2.blur(part, (3, 3))
    else:
        height, width = (n // scale for n in part.shape[:2])
        whole = part[: height * scale, : width * scale]
        smooth = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    classes = np.empty(smooth.shape[:2], dtype=np.uint8)
    kernels.classify(smooth, palette.table, palette.least_value, palette.least_saturation, classes)
    return classes


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """A picture, the classes of its pixels at 1 / scale of its size, and what a mark is."""

    part: Picture
    classes: Picture
    palette: _Palette
    scale: int
    min_area_px: float
    max_area_px: float
    outline: Outline | None

    def detected(self, contour: Picture, number: int, hue_deg: float) -> Detection | None:
        """The mark inside this contour of the classes; None where it is no mark."""
        u, v, width, height = (self.scale * n for n in cv2.boundingRect(contour))
        if width * height < SEARCH_SHARE * self.min_area_px:
            return None
        frame_height, frame_width = self.part.shape[:2]
        pad = PAD_PX + max(width, height) // 8
        u0, v0 = max(u - pad, 0), max(v - pad, 0)
        u1, v1 = min(u + width + pad, frame_width), min(v + height + pad, frame_height)
        patch = np.ascontiguousarray(self.part[v0:v1, u0:u1])
        component = np.zeros(patch.shape[:2], dtype=np.uint8)
        if self.scale == 1:
            cv2.drawContours(component, [contour], -1, 1, cv2.FILLED, offset=(-u0, -v0))
            same = _equal(self.classes[v0:v1, u0:u1], number)
        else:
            cv2.drawContours(component, [self.scale * contour], -1, 1, cv2.FILLED, offset=(-u0, -v0))
            around = cv2.dilate(component, SQUARE_5)
            same = _equal(_classes(patch, self.palette, 1), number)
            pieces, _ = cv2.findContours(same & around, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
            component[:] = 0
            cv2.drawContours(component, pieces, -1, 1, cv2.FILLED)
        if cv2.countNonZero(component) < SEARCH_SHARE * self.min_area_px or _elongation(component) > MAX_ELONGATION:
            return None
        others = cv2.dilate(same & (1 - component), SQUARE_5)
        seen = cover(patch, component, others)
        if seen is None or not self.min_area_px <= seen.area_px <= self.max_area_px:
            return None
        center, cov, covered = seen.center_px, seen.cov_px2, False
        if self.outline is not None:
            fitted = fit_outline(seen.alpha, center, self.outline)
            if fitted is None:
                if seen.area_px < 0.5 * self.outline.area_px:
                    return None
            else:
                apart = fitted.center_px - center
                if _squared(apart, cov + fitted.cov_px2) > APART:
                    if fitted.beyond <= BEYOND:
                        center, cov, covered = fitted.center_px, fitted.cov_px2, True
                    else:
                        cov = cov + np.outer(apart, apart)
        clipped = min(u, v) == 0 or u + width > frame_width - self.scale or v + height > frame_height - self.scale
        # Of a mark that the border cuts, as much again as is seen may lie outside.
        outside = (max(width, height) / 2.0) ** 2 if clipped and not covered else 0.0
        placed = center + np.array([u0, v0])
        return Detection(placed, cov + outside * np.eye(2), seen.area_px, hue_deg, clipped, covered, seen.color_bgr)


def _pieced(found: Sequence[Detection], outline: Outline) -> list[Detection]:
    """Fragments of one mark, as a needle across it leaves them, put together."""
    near = ONE_MARK * (outline.area_px / np.pi) ** 0.5
    whole: list[Detection] = []
    for one in found:
        k = next((k for k, other in enumerate(whole) if np.hypot(*(one.center_px - other.center_px)) < near), None)
        if k is None:
            whole.append(one)
            continue
        other = whole[k]
        information = [np.linalg.inv(d.cov_px2) for d in (one, other)]
        cov = np.linalg.inv(information[0] + information[1])
        center = cov @ (information[0] @ one.center_px + information[1] @ other.center_px)
        whole[k] = replace(other, center_px=center, cov_px2=cov, area_px=one.area_px + other.area_px)
    return whole


def _squared(off: Floats, cov: Floats) -> float:
    """Mahalanobis distance of off, (2,), squared, by cov, (2, 2), written out."""
    (u, v), ((uu, uv), (_, vv)) = off.tolist(), cov.tolist()
    return (vv * u * u - 2.0 * uv * u * v + uu * v * v) / (uu * vv - uv * uv)


def _elongation(component: Picture) -> float:
    m = cv2.moments(component, binaryImage=True)
    uu, vv, uv = m["mu20"] / m["m00"], m["mu02"] / m["m00"], m["mu11"] / m["m00"]
    # A pixel is no point: a row of pixels still has the width of one (1/12 px²).
    mean, half = (uu + vv) / 2.0 + 1.0 / 12.0, np.hypot((uu - vv) / 2.0, uv)
    return float(np.sqrt((mean + half) / (mean - half)))
