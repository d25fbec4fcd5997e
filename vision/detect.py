"""Marks in a frame: found by hue, placed between the pixels by how much of each pixel the mark covers.

Image axes: u right, v down, the centre of the first pixel is (0, 0).

A pixel at a mark's edge shows the mark over a share alpha of it and what lies behind over the rest. Where the colour of
both is known, alpha is a linear function of the pixel; its centre of gravity has no bias from any threshold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.coverage import PAD_PX, Cover, Picture, cover
from vision.hues import MarkHue
from vision.outline import Fitted, Outline, fit_outline
from vision.palette import Palette, classes_of, equal, palette_of
from vision.rim import fit_rim

Floats = NDArray[np.float64]
Image = NDArray[np.uint8]

LARGEST_SHARE = 0.3
"""A range of hues that takes more of the picture than this shows the scene, not marks; chosen."""
MAX_ELONGATION = 4.0
"""Longest to shortest axis of what may be a mark: round marks smeared by up to three times their width; chosen."""
SEARCH_SHARE = 0.4
"""A mark may show this share of its least area in the search already; its edge counts only after that; chosen."""
COARSE_AREA_PX = 60.0
"""Marks of at least so many pixels are searched for in a picture of half the size; chosen."""
APART = 13.815510557964274
"""Squared distance beyond which two centres of one mark, by area and by outline, differ: chi-square, 0.1 %."""
AGREE_PX2 = 0.08**2 * np.eye(2)
"""Covariance of what two centres of one mark may differ by whatever they say of themselves: shading, print; chosen."""
BEYOND = 0.1
"""Where more than this share of the edge lies outside the outline, a mark is not covered but smeared; chosen."""
SQUARE_5 = np.ones((5, 5), np.uint8)
GRAIN_NOISE, GRAIN_GAIN = 0.018, 2.0
"""Noise of a pixel by a mark's contrast from which errors of an outline hang together more than it shows, and what that
adds to their variance at most: compression, highlights, shadow; measured on drawn frames."""
FAINTEST = 0.2
"""Noise of a pixel by a mark's contrast, above which it is a stain of what is around it; measured on drawn frames:
marks 0.01 to 0.15, grains of a hand's colour 0.19 to 0.4."""
WHOLE_AT_LEAST = 0.5
"""A mark whose outline cannot be told must show this share of its area; chosen."""
SMEAR = 0.12
"""Variance of the rim's centre by the spread of the way that the mark moved during the exposure; chosen."""
UNEVEN = 0.01
"""By what shading pulls the rim of a ball, by its size, were all of the rim seen; measured on real films."""
BLURRED = 1.2
"""Spread of a mark at rest by that of its outline, at most; chosen."""
RIM_SEEN = 0.3
"""Below this share of a rim, weighed by how clear it is, part of the mark is covered; chosen."""
ALL_SEEN = 0.9
"""Of its area a mark shows this share, or something covers part of it; chosen."""
WHOLE_AT_MOST = 1.6
"""Nor may it show more than this: a hand, blood; chosen."""
MERGED = 1.25
"""From this share of a mark's area on, two of them may hang together; chosen."""
NEXT = 1.4
"""How far from where it is expected the edge of one of several marks is looked for, in sizes of it; chosen."""
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
    size: by that of the outline it was looked for with
    """

    center_px: Floats
    cov_px2: Floats
    area_px: float
    hue_deg: float
    clipped: bool
    covered: bool = False
    color_bgr: tuple[float, ...] = (0.0, 0.0, 0.0)
    size: float = 1.0


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
) -> list[Detection]:
    """Marks of these hues, largest first.

    frame_bgr: shape (height, width, 3), uint8
    min_area_px, max_area_px: least and largest area that is seen of a mark [px]
    region: left, top, width, height of the part to search [px]; all of the frame where None
    outlines: what a whole mark looks like, one for all or one for each expected mark, of which the nearest counts; with
        it, marks that are partly covered are found at their centre
    expected_px, expected_hues: where marks are expected, (n, 2), and of which hue; they help to tell apart marks that
        touch, and which outline a mark has

    Raises ValueError for a picture or region of another kind, HueError where a hue takes most of the picture.
    """
    if not isinstance(frame_bgr, np.ndarray) or frame_bgr.dtype != np.uint8 or frame_bgr.shape[2:] != (3,):
        kind = f"{getattr(frame_bgr, 'dtype', type(frame_bgr).__name__)} {np.shape(frame_bgr)}"
        raise ValueError(f"frame: expected uint8 (height, width, 3), found {kind}")
    left, top = (0, 0) if region is None else region[:2]
    part = frame_bgr if region is None else _cut(frame_bgr, region)
    if not hues:
        return []
    palette = palette_of(tuple(hues))
    scale = 2 if region is None and min_area_px >= COARSE_AREA_PX and min(part.shape[:2]) > 1 else 1
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
    )
    found: list[Detection] = []
    for number, hue in enumerate(hues, start=1):
        mask = classes if len(hues) == 1 else equal(classes, number)
        if region is None:
            _check_share(hue, cv2.countNonZero(mask) / mask.size)
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


def _check_share(hue: MarkHue, share: float) -> None:
    if share > LARGEST_SHARE:
        raise HueError(
            f"hue {hue.hue_deg:g} ± {hue.half_width_deg:g} degrees: expected marks on up to {LARGEST_SHARE:.0%} "
            f"of the picture, found {share:.0%}; narrow the range or raise min_saturation ({hue.min_saturation:g})"
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """Pixels that hang together and may be a mark.

    corner_px: of the patch in the picture, (2,); patch: (h, w, 3) BGR; component, others: its pixels, and those of
    other marks, 1 or 0, (h, w); reach_px: its longer side; clipped: it touches the border of the picture
    """

    corner_px: Floats
    patch: Picture
    component: Picture
    others: Picture
    reach_px: float
    clipped: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Center:
    """As in `Detection`, from the patch's corner."""

    center_px: Floats
    cov_px2: Floats
    covered: bool = False
    size: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """A picture, the classes of its pixels at 1 / scale of its size, and what a mark is.

    outlines: of a whole mark, one for all or one for each that is expected; starts_px: where they are, (n, 2)
    corner_px: of this picture in the frame, (2,); hues_deg: of those that are expected, none where all are alike
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

    def detected(self, contour: Picture, number: int, hue_deg: float) -> list[Detection]:
        """The marks inside this contour of the classes."""
        piece = self._piece(contour, number)
        seen = None if piece is None else cover(piece.patch, piece.component, piece.others, thorough=not self.outlines)
        if piece is None or seen is None:
            return []
        if seen.noise_sd > FAINTEST and all(one.even for one in self.outlines):
            return []
        if not self.min_area_px <= seen.area_px <= self.max_area_px:
            return []

        outline = self._outline(piece.corner_px + seen.center_px, hue_deg)
        whole = _Center(seen.center_px, seen.cov_px2)
        centers = [whole]
        if outline is not None:
            grain = (seen.noise_sd / GRAIN_NOISE) ** 4
            factor = 1.0 + outline.even * GRAIN_GAIN * grain / (1.0 + grain)
            centers = self._outlined(piece, seen, outline)
            if factor != 1.0:
                centers = [replace(at, cov_px2=factor * at.cov_px2) for at in centers]
        # Of a mark that the border cuts, as much again as is seen may lie outside.
        outside = (piece.reach_px / 2.0) ** 2 * np.eye(2) if piece.clipped else 0.0
        return [
            Detection(
                at.center_px + piece.corner_px + self.corner_px,
                at.cov_px2 if at.covered else at.cov_px2 + outside,
                seen.area_px,
                hue_deg,
                piece.clipped,
                at.covered,
                seen.color_bgr,
                at.size,
            )
            for at in centers
        ]

    def _outline(self, place_px: Floats, hue_deg: float) -> Outline | None:
        """What the mark of this hue that is expected nearest to this place looks like."""
        if len(self.outlines) < 2:
            return self.outlines[0] if self.outlines else None
        off = np.linalg.norm(self.starts_px - place_px, axis=1)
        if self.hues_deg:
            off = np.where(np.array(self.hues_deg) == hue_deg, off, np.inf)
        return self.outlines[int(np.argmin(off))]

    def _outlined(self, piece: _Piece, seen: Cover, outline: Outline) -> list[_Center]:
        """Centres from the piece's patch: of one mark, whole or covered, of several that touch, or none."""
        whole = _Center(seen.center_px, seen.cov_px2)
        fitted = fit_outline(seen.alpha, seen.center_px, outline)
        share = seen.area_px / outline.area_px
        if outline.even:
            if share > MERGED and (fitted is None or fitted.beyond > BEYOND):
                expected = self._inside(piece)
                starts = _starts(piece, expected, outline)
                several = [fit_outline(seen.alpha, start, outline, reach=NEXT) for start in starts]
                if all(several) and (len(expected) > 1 or _apart(several, outline)):
                    return [_Center(one.center_px, one.cov_px2, True, one.size) for one in several if one is not None]
            if fitted is not None:
                apart = fitted.center_px - seen.center_px
                squared = _squared(apart, seen.cov_px2 + fitted.cov_px2 + AGREE_PX2)
                if squared <= APART and WHOLE_AT_LEAST <= share <= WHOLE_AT_MOST:
                    cov = max(1.0, squared / 2.0) * fitted.cov_px2
                    return [_Center(fitted.center_px, cov, False, fitted.size)]
        rim = self._rim(piece, whole, fitted, outline)
        if rim is not None:
            return [replace(rim, covered=rim.covered or share < ALL_SEEN * rim.size**2)]
        if fitted is not None and fitted.beyond <= BEYOND:
            return [_Center(fitted.center_px, fitted.cov_px2, True, fitted.size)]
        if share < WHOLE_AT_LEAST or (outline.even and share > WHOLE_AT_MOST):
            return []
        # of its outline nothing is to be told: somewhere within it
        return [replace(whole, cov_px2=whole.cov_px2 + outline.area_px / (4.0 * np.pi) * np.eye(2))]

    def _rim(self, piece: _Piece, whole: _Center, fitted: Fitted | None, outline: Outline) -> _Center | None:
        """The centre by the steps of colour around a piece; None where they make no rim."""
        circles = [(*whole.center_px, 1.0), *((u, v, 1.0) for u, v in self._inside(piece))]
        if fitted is not None:
            circles.append((*fitted.center_px, fitted.size))
        rim = fit_rim(piece.patch, np.array(circles), outline)
        if rim is None or (outline.even and rim.share < RIM_SEEN):
            return None
        cov = rim.cov_px2 + SMEAR * _smear(piece.component, outline)
        if not outline.even:
            cov = cov + UNEVEN**2 / rim.share * outline.shape_px @ outline.shape_px.T
        return _Center(rim.center_px, cov, piece.clipped or rim.share < RIM_SEEN, rim.size)

    def _inside(self, piece: _Piece) -> list[Floats]:
        """Where marks are expected inside a piece, from its patch's corner [px]."""
        height, width = piece.component.shape
        places = [place - piece.corner_px for place in self.starts_px]
        in_patch = [p for p in places if 0 <= p[0] < width and 0 <= p[1] < height]
        return [p for p in in_patch if piece.component[int(p[1]), int(p[0])]]

    def _piece(self, contour: Picture, number: int) -> _Piece | None:
        """The pixels inside this contour, holes filled; None where they are too few or too long to be a mark."""
        u, v, width, height = (self.scale * n for n in cv2.boundingRect(contour))
        least = SEARCH_SHARE * self.min_area_px
        if width * height < least:
            return None
        frame_height, frame_width = self.part.shape[:2]
        pad = PAD_PX + max(width, height) // 8
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
        if cv2.countNonZero(component) < least or _elongation(component) > MAX_ELONGATION:
            return None
        others = cv2.dilate(same & (1 - component), SQUARE_5)
        clipped = min(u, v) == 0 or u + width > frame_width - self.scale or v + height > frame_height - self.scale
        return _Piece(np.array([u0, v0], dtype=float), patch, component, others, float(max(width, height)), clipped)


def _starts(piece: _Piece, expected_px: list[Floats], outline: Outline) -> Floats:
    """Places inside a piece where marks that hang together begin to be looked for, (n, 2)."""
    if len(expected_px) > 1:
        return np.array(expected_px)
    v, u = np.nonzero(piece.component)
    places = np.column_stack([u, v]).astype(float)
    middle = places.mean(axis=0)
    along = np.linalg.eigh(np.cov(places.T))[1][:, 1]
    lengths = (places - middle) @ along
    radius = (outline.area_px / np.pi) ** 0.5
    return middle + np.array([[lengths.min() + radius], [lengths.max() - radius]]) * along


def _apart(several: Sequence[Fitted | None], outline: Outline) -> bool:
    """Whether centres are those of different marks, and not of one that is larger than it was thought to be."""
    near = ONE_MARK * (outline.area_px / np.pi) ** 0.5
    pairs = combinations((one.center_px for one in several if one is not None), 2)
    return all(np.hypot(*(a - b)) > near for a, b in pairs)


def _smear(component: Picture, outline: Outline) -> Floats:
    """By how much a piece is spread wider than a mark at rest [px²], (2, 2)."""
    m = cv2.moments(component, binaryImage=True)
    spread = np.array([[m["mu20"], m["mu11"]], [m["mu11"], m["mu02"]]]) / m["m00"]
    # of a disc: a quarter of its radius squared; a blurred edge adds some
    values, vectors = np.linalg.eigh(spread - BLURRED * outline.shape_px @ outline.shape_px.T / 4.0)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T, dtype=np.float64)


def _pieced(found: Sequence[Sequence[Detection]], outline: Outline) -> list[Detection]:
    """All that was found in the pieces of a picture; fragments of one mark, as a needle leaves them, put together."""
    near = ONE_MARK * (outline.area_px / np.pi) ** 0.5
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
