"""Detection of marks by hue, with sub-pixel centres from the share of each pixel that the mark covers.

A mark covers the share alpha of a pixel at its edge; the background fills the rest. If both colours are known, alpha is
a linear function of the pixel's colour. The mark's centre is the centre of gravity of alpha. No threshold is needed.
Image axes: u right, v down, the centre of the first pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike

from vision.arrays import Floats, Image, Picture
from vision.detection.centers import Center, Component, centers_of
from vision.detection.coverage import measure_coverage
from vision.detection.hue import MarkHue
from vision.detection.outline import Outline
from vision.detection.palette import Palette, classes_of, equal, palette_of
from vision.detection.records import Detection, HueError, Reason, Rejected
from vision.detection.settings import DETECTION, DetectionSettings

BLOCK_AREA_PX = 8.0 * np.pi
"""A circle of at least this area [px] covers a whole block of 2 x 2 pixels at any position; source: geometry. Blocks
begin at even coordinates. The circle's centre is at most sqrt(2) px from the middle of the nearest block. Each corner
of a block is sqrt(2) px from the middle of this block."""

SQUARE_5 = np.ones((5, 5), np.uint8)


def detect_marks(
    frame_bgr: Image,
    hues: Sequence[MarkHue],
    *,
    min_area_px: float,
    max_area_px: float | None = None,
    region: tuple[int, int, int, int] | None = None,
    outlines: Sequence[Outline] = (),
    expected_px: ArrayLike = (),
    expected_hues: Sequence[float] = (),
    settings: DetectionSettings = DETECTION,
    rejected: list[Rejected] | None = None,
) -> list[Detection]:
    """Detect the marks of these hues. The largest mark is first in the result.

    frame_bgr: shape (height, width, 3), uint8
    min_area_px, max_area_px: least and largest visible area of a mark [px]
    region: left, top, width, height of the searched part [px]; None: the whole frame
    outlines: outline of a completely visible mark: one for all marks, or one for each expected mark. Without outlines,
        the centre of a partly covered mark cannot be found.
    expected_px: expected positions of marks, (n, 2); they help to separate touching marks and to select an outline
    expected_hues: hues of the expected marks; empty if all marks have one hue
    rejected: list to which rejected groups of pixels are appended; None: not recorded

    Raises ValueError for an invalid picture or region. Raises HueError if a hue covers most of the picture.
    """
    if not isinstance(frame_bgr, np.ndarray) or frame_bgr.dtype != np.uint8 or frame_bgr.shape[2:] != (3,):
        kind = f"{getattr(frame_bgr, 'dtype', type(frame_bgr).__name__)} {np.shape(frame_bgr)}"
        raise ValueError(f"frame: expected uint8 (height, width, 3), found {kind}")
    left, top = (0, 0) if region is None else region[:2]
    part = frame_bgr if region is None else _cut(frame_bgr, region)
    if not hues:
        return []
    palette = palette_of(tuple(hues))
    large = settings.centers.min_area * min_area_px >= BLOCK_AREA_PX
    scale = 2 if region is None and large and min(part.shape[:2]) > 1 else 1
    classes = classes_of(part, palette, scale)
    corner = np.array([left, top], dtype=float)
    starts = np.reshape(expected_px, (-1, 2)) - corner
    search = _Search(
        part,
        classes,
        palette,
        scale,
        min_area_px,
        max_area_px or np.inf,
        tuple(outlines),
        starts,
        corner,
        tuple(expected_hues),
        settings,
        rejected,
    )
    found: list[Detection] = []
    for number, hue in enumerate(hues, start=1):
        mask = classes if len(hues) == 1 else equal(classes, number)
        if region is None:
            _check_share(hue, cv2.countNonZero(mask) / mask.size, settings.components.max_picture_share)
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        of_hue = [search.detected(contour, number, hue.hue_deg) for contour in contours]
        found += (
            _pieced(of_hue, min(outlines, key=lambda one: one.area_px))
            if outlines
            else [d for each in of_hue for d in each]
        )
    return sorted(found, key=lambda detection: -detection.area_px)


def _cut(frame: Image, region: tuple[int, int, int, int]) -> Image:
    left, top, width, height = region
    if left < 0 or top < 0 or min(width, height) < 1 or left + width > frame.shape[1] or top + height > frame.shape[0]:
        raise ValueError(
            f"region: expected left, top, width, height inside {frame.shape[1]} x {frame.shape[0]} px, found {region}"
        )
    return frame[top : top + height, left : left + width]


def _check_share(hue: MarkHue, share: float, most: float) -> None:
    if share > most:
        raise HueError(
            f"hue {hue.hue_deg:g} ± {hue.half_width_deg:g} degrees: expected marks on up to {most:.0%} "
            f"of the picture, found {share:.0%}; narrow the range or raise min_saturation ({hue.min_saturation:g})"
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """Inputs of `detect_marks` for part of a frame.

    part: this part of the frame; scale: factor by which the part is reduced before its pixels are classified
    classes: colour class of each pixel of the reduced part
    starts_px: expected positions in the part, (n, 2); corner_px: position of the part's first pixel in the frame, (2,)
    hues_deg: parameter expected_hues of `detect_marks`
    """

    part: Picture
    classes: Picture
    palette: Palette
    scale: int
    min_area_px: float
    max_area_px: float
    outlines: tuple[Outline, ...]
    starts_px: Floats
    corner_px: Floats
    hues_deg: tuple[float, ...]
    settings: DetectionSettings
    rejected: list[Rejected] | None

    def detected(self, contour: Picture, number: int, hue_deg: float) -> list[Detection]:
        """Detect the marks in the component that lies inside a contour."""
        piece = self._piece(contour, number, hue_deg)
        if piece is None:
            return []
        seen = measure_coverage(
            piece.patch, piece.component, piece.others, self.settings.coverage, thorough=not self.outlines
        )
        if seen is None:
            return self._none(Reason.CONTRAST, piece, hue_deg)
        if not self.min_area_px <= seen.area_px <= self.max_area_px:
            return self._none(Reason.SIZE, piece, hue_deg)
        if seen.noise_sd > self.settings.components.max_noise and all(one.even for one in self.outlines):
            return self._none(Reason.STAIN, piece, hue_deg)

        outline = self._outline(piece.corner_px + seen.center_px, hue_deg)
        whole = Center(seen.center_px, seen.cov_px2)
        centers = [whole]
        if outline is not None:
            centers = centers_of(piece, seen, outline, self._inside(piece), self.settings)
            if not centers:
                return self._none(Reason.SHAPE, piece, hue_deg)
        # the hidden part of a clipped mark may be as large as the visible part
        outside = (piece.reach_px / 2.0) ** 2 * np.eye(2) if piece.clipped else 0.0
        return [
            Detection(
                at.center_px + piece.corner_px + self.corner_px,
                at.cov_px2 if at.occluded else at.cov_px2 + outside,
                seen.area_px,
                hue_deg,
                piece.clipped,
                at.occluded,
                seen.color_bgr,
                at.size,
            )
            for at in centers
        ]

    def _outline(self, place_px: Floats, hue_deg: float) -> Outline | None:
        """Outline of the expected mark of this hue that is nearest to place_px; None without outlines."""
        if len(self.outlines) < 2:
            return self.outlines[0] if self.outlines else None
        distances = np.linalg.norm(self.starts_px - place_px, axis=1)
        if self.hues_deg:
            distances = np.where(np.array(self.hues_deg) == hue_deg, distances, np.inf)
        return self.outlines[int(np.argmin(distances))]

    def _inside(self, piece: Component) -> list[Floats]:
        """The expected positions on a component [px], each (2,), relative to the corner of the component's patch."""
        height, width = piece.component.shape
        places = self.starts_px - piece.corner_px
        in_patch = places[((places >= 0.0) & (places < (width, height))).all(axis=1)]
        return [p for p in in_patch if piece.component[int(p[1]), int(p[0])]]

    def _piece(self, contour: Picture, number: int, hue_deg: float) -> Component | None:
        """The component inside a contour, without holes; None if it is too small or too elongated for a mark."""
        u, v, width, height = (self.scale * n for n in cv2.boundingRect(contour))
        least = self.settings.centers.min_area * self.min_area_px
        if width * height < least:
            if self.rejected is not None:
                self.rejected.append(self._speck(contour, hue_deg))
            return None
        frame_height, frame_width = self.part.shape[:2]
        pad = self.settings.coverage.pad_px + max(width, height) // 8
        u0, v0 = max(u - pad, 0), max(v - pad, 0)
        u1, v1 = min(u + width + pad, frame_width), min(v + height + pad, frame_height)
        patch = np.ascontiguousarray(self.part[v0:v1, u0:u1])
        component = np.zeros(patch.shape[:2], dtype=np.uint8)
        cv2.drawContours(component, [self.scale * contour], -1, 1, cv2.FILLED, offset=(-u0, -v0))
        if self.scale == 1:
            same = equal(self.classes[v0:v1, u0:u1], number)
        else:
            same = equal(classes_of(patch, self.palette, 1), number)
            near = same & cv2.dilate(component, SQUARE_5)
            pieces, _ = cv2.findContours(near, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
            component[:] = 0
            cv2.drawContours(component, pieces, -1, 1, cv2.FILLED)
        pixels = cv2.countNonZero(component)
        few = pixels < least
        if few or _elongation(component) > self.settings.components.max_elongation:
            corner, reason = np.array([u0, v0], dtype=float), Reason.FEW_PIXELS if few else Reason.SHAPE
            if pixels:  # there are no pixels if only smoothing produced the hue
                self._none(reason, Component(corner, patch, component, same, float(max(width, height)), False), hue_deg)
            return None
        others = cv2.dilate(same & (1 - component), SQUARE_5)
        clipped = min(u, v) == 0 or u + width > frame_width - self.scale or v + height > frame_height - self.scale
        return Component(np.array([u0, v0], dtype=float), patch, component, others, float(max(width, height)), clipped)

    def _none(self, reason: Reason, piece: Component, hue_deg: float) -> list[Detection]:
        """Record the rejected piece if requested, and return an empty list."""
        if self.rejected is not None:
            self.rejected.append(self._rejected(reason, piece, hue_deg))
        return []

    def _speck(self, contour: Picture, hue_deg: float) -> Rejected:
        """Record of a contour with too few pixels for a mark. Pick's theorem gives the number of pixels inside it."""
        pixels = self.scale**2 * (cv2.contourArea(contour) + len(contour) / 2.0 + 1.0)
        middle = self.scale * (contour.reshape(-1, 2).mean(axis=0) + 0.5) - 0.5
        return Rejected(Reason.FEW_PIXELS, self._of_least(pixels), middle + self.corner_px, pixels, hue_deg)

    def _of_least(self, pixels: float) -> str:
        return f"{pixels:.0f} px of at least {self.min_area_px:.0f}"

    def _rejected(self, reason: Reason, piece: Component, hue_deg: float) -> Rejected:
        """Record of a rejected component.

        The reason becomes SIZE if the component is too large, or is a whole mark of another size. Otherwise, the reason
        becomes FEW_PIXELS if there are too few pixels.
        """
        m = cv2.moments(piece.component, binaryImage=True)
        pixels, center_px = m["m00"], np.array([m["m10"], m["m01"]]) / m["m00"] + piece.corner_px
        outline = self._outline(center_px, hue_deg)
        share = np.nan if outline is None else pixels / outline.area_px
        limits, detail = self.settings.centers, ""
        few = pixels < self.min_area_px
        if share > limits.max_area or ((few or share < limits.min_area) and _is_whole(m, outline, self.settings)):
            reason, detail = Reason.SIZE, f"{share**0.5:.2g} of its diameter"
        elif few:
            reason, detail = Reason.FEW_PIXELS, self._of_least(pixels)
        elif reason is Reason.SIZE:
            detail = f"{pixels:.0f} px"
        elif reason is Reason.SHAPE:
            long = _elongation(piece.component)
            is_long = long > self.settings.components.max_elongation
            detail = f"{long:.1f} times as long as wide" if is_long else "no edge on its outline"
        return Rejected(reason, detail, center_px + self.corner_px, pixels, hue_deg)


def _is_whole(moments: Mapping[str, float], outline: Outline | None, settings: DetectionSettings) -> bool:
    """Whether pixels have the shape of an outline, at any size; False if there are too few pixels to decide.

    For a disc of area A, the sum of the two second moments about the centre is `A² / (2 pi)`. Other shapes have a
    larger sum.
    """
    if outline is None or moments["m00"] < BLOCK_AREA_PX:
        return False
    spread = np.array([[moments["mu20"], moments["mu11"]], [moments["mu11"], moments["mu02"]]]) / moments["m00"]
    inverse = np.linalg.inv(outline.shape_px)
    round_like = moments["m00"] / outline.area_px / (2.0 * float(np.trace(inverse @ spread @ inverse.T)))
    return bool(round_like >= settings.outline.whole_share)


def _pieced(found: Sequence[Sequence[Detection]], outline: Outline) -> list[Detection]:
    """Join the detections of one hue that are fragments of one mark: a needle, for example, divides a mark."""
    near = (outline.area_px / np.pi) ** 0.5
    whole = [detection for several in found if len(several) > 1 for detection in several]
    fragments: list[Detection] = []
    for one in (several[0] for several in found if len(several) == 1):
        k = next((k for k, other in enumerate(fragments) if np.hypot(*(one.center_px - other.center_px)) < near), None)
        if k is None:
            fragments.append(one)
            continue
        other = fragments[k]
        information = [np.linalg.inv(d.cov_px2) for d in (one, other)]
        cov = np.linalg.inv(information[0] + information[1])
        center = cov @ (information[0] @ one.center_px + information[1] @ other.center_px)
        fragments[k] = replace(other, center_px=center, cov_px2=cov, area_px=one.area_px + other.area_px)
    return whole + fragments


def _elongation(component: Picture) -> float:
    m = cv2.moments(component, binaryImage=True)
    uu, vv, uv = m["mu20"] / m["m00"], m["mu02"] / m["m00"], m["mu11"] / m["m00"]
    # A pixel has the second moment 1/12 px² along each axis. So a single row of pixels is one pixel wide.
    mean, half = (uu + vv) / 2.0 + 1.0 / 12.0, np.hypot((uu - vv) / 2.0, uv)
    return float(np.sqrt((mean + half) / (mean - half)))
