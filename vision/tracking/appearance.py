"""Appearance model of a mark: views of the completely visible mark, and their best match in a picture.

If blood of a mark's colour touches the mark, or if a hand covers half of it, the pixels of this colour do not have the
mark's shape. In both cases, the picture is compared with earlier views. Image axes: u right, v down, in pixels.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import cached_property
from math import ceil, sqrt
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.arrays import Floats, Image
from vision.detection.expected import Expected
from vision.detection.outline import Outline
from vision.tracking.likeness import likeness, likeness_in_other_light, median_color, median_picture, pixels_of
from vision.tracking.settings import FINDER, REACH_SDS, AppearanceSettings

COARSE_PX = 3
"""Distance between positions in the first search for a mark with a fitted colour [px]. A finer search follows."""


@dataclass(frozen=True, slots=True, eq=False)
class AppearanceMatch:
    """The position in a picture that best matches a mark.

    center_px: centre of the mark [px], (2,)
    score: similarity inside the mark minus `AppearanceSettings.ring_weight` times around; from -1.5 to 1.5
    share: share of similar pixels in the mark
    around: similarity between the ring of pixels around the mark and the mark's colour, from -1 to 1
    color_bgr: median colour of the similar pixels [grey levels]
    weighed: score minus a loss for the distance from the mark's expected position
    """

    center_px: Floats
    score: float
    share: float
    around: float
    color_bgr: tuple[float, ...]
    weighed: float


@dataclass(frozen=True, slots=True, eq=False)
class _Template:
    """The median view of a mark and its surroundings.

    inside, ring: pixels of the mark and of the ring around the mark, relative to the mark's centre, each (n, 2)
    colors: colours of the pixels `inside`, (n, 3)
    core: median colour of the pixels `inside`, (3,); behind: median colour of the pixels `ring`, (3,)
    """

    inside: NDArray[np.int64]
    ring: NDArray[np.int64]
    colors: Floats
    core: Floats
    behind: Floats
    settings: AppearanceSettings

    @property
    def blends(self) -> bool:
        """Whether the background is so similar to the mark that they cannot be distinguished."""
        return bool(self.settings.ring_contrast * _squared(self.behind, self.core, self.settings) < 1.0)


class _View:
    """A stored view of a mark: part of a frame, the mark's centre in that part, (2,), and the mark's shape, (2, 2)."""

    def __init__(self, picture: Image, center_px: Floats, shape_px: Floats, blur_px: float) -> None:
        self._sharp, self.center_px, self._shape, self._blur_px = picture, center_px, shape_px, blur_px
        self._drawn: tuple[bytes, Image] | None = None

    @cached_property
    def picture(self) -> Image:
        """The smoothed view, computed on demand, because most views are never compared."""
        return np.asarray(cv2.GaussianBlur(self._sharp, (0, 0), self._blur_px), dtype=np.uint8)

    def redrawn(self, inverse: Floats, half: int) -> Image:
        """The view, with another shape of the mark. inverse: inverse of this shape; half: half the new width [px]."""
        key = inverse.tobytes()
        if self._drawn is None or self._drawn[0] != key:
            turn = self._shape @ inverse
            back = np.hstack([turn, (self.center_px - turn @ (half, half))[:, None]])
            size, flags = (2 * half + 1, 2 * half + 1), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            drawn = cv2.warpAffine(self.picture, back, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
            self._drawn = key, np.asarray(drawn, dtype=np.uint8)
        return self._drawn[1]


class AppearanceModel:
    """The appearance of one mark in the last frames that showed it completely.

    hue_deg: hue of the mark; unseen: number of frames since the last stored view. The caller counts these frames.
    """

    def __init__(self, hue_deg: float, settings: AppearanceSettings = FINDER.appearance) -> None:
        self.hue_deg, self._settings = hue_deg, settings
        self.unseen = 0
        self._kept: deque[_View] = deque(maxlen=settings.n_views)
        self._drawn: tuple[bytes, _Template] | None = None

    @property
    def is_full(self) -> bool:
        """Whether the model has `AppearanceSettings.n_views` views."""
        return len(self._kept) == self._settings.n_views

    def remember(self, frame_bgr: Image, center_px: Floats, outline: Outline) -> None:
        """Store the view of the mark in a frame, unless the view extends beyond the picture."""
        half = _half(outline, self._settings) + 2
        x, y = center_px.tolist()
        u, v = round(x), round(y)
        height, width = frame_bgr.shape[:2]
        if half <= u < width - half and half <= v < height - half:
            view = frame_bgr[v - half : v + half + 1, u - half : u + half + 1]
            center_px = np.array([x - u + half, y - v + half])
            self._kept.append(_View(view.copy(), center_px, outline.shape_px, self._settings.blur_px))
            self._drawn, self.unseen = None, 0

    def place(
        self,
        frame_bgr: Image,
        expected: Expected,
        about_px: Floats | None = None,
        *,
        within_px: float | None = None,
        another: bool = False,
    ) -> AppearanceMatch | None:
        """The best match of the mark's appearance near its expected position.

        about_px, within_px: centre [px], (2,), and half width [px] of a square. If given, only positions in the square
            are compared.
        another: whether to fit the mark's colour at each position, because the light may have changed

        Returns None if the expected position is too uncertain, or if mark and background cannot be distinguished.
        """
        settings, outline = self._settings, expected.outline
        reach = REACH_SDS * float(np.sqrt(np.linalg.eigvalsh(expected.cov_px2)[-1]))
        if outline is None or not self._kept or reach > settings.max_reach_px:
            return None
        template = self._template(outline)
        height, width = frame_bgr.shape[:2]
        u0, v0 = (max(int(np.ceil(x - reach)), 0) for x in expected.center_px)
        u1, v1 = (min(int(x + reach) + 1, size) for x, size in zip(expected.center_px, (width, height), strict=True))
        if within_px is not None and about_px is not None:
            (u, v), far = (round(float(x)) for x in about_px), ceil(within_px)
            u0, v0, u1, v1 = max(u - far, u0), max(v - far, v0), min(u + far + 1, u1), min(v + far + 1, v1)
        if (template.blends and not another) or u1 <= u0 or v1 <= v0:
            return None
        pad = _half(outline, settings) + 3
        corner = left, top = max(u0 - pad, 0), max(v0 - pad, 0)
        part = np.asarray(
            cv2.GaussianBlur(frame_bgr[top : v1 + pad, left : u1 + pad], (0, 0), settings.blur_px), dtype=np.uint8
        )
        box = (u0, v0, u1, v1)
        if another:
            # the colour is fitted at every third position, then at each position near the best one
            _, weighed = _weighed(part, corner, box, template, expected, COARSE_PX, another)
            j, i = divmod(int(np.argmax(weighed)), weighed.shape[1])
            u, v, far = u0 + COARSE_PX * i, v0 + COARSE_PX * j, COARSE_PX
            box = u0, v0, u1, v1 = max(u - far, u0), max(v - far, v0), min(u + far + 1, u1), min(v + far + 1, v1)
        evidence, weighed = _weighed(part, corner, box, template, expected, 1, another)
        j, i = divmod(int(np.argmax(weighed)), weighed.shape[1])
        center = np.array([u0 + i + _peak(weighed[j], i), v0 + j + _peak(weighed[:, i], j)])
        u, v = (template.inside + np.array([u0 + i - left, v0 + j - top])).clip(0, np.array(part.shape[1::-1]) - 1).T
        pixels = part[v, u].astype(np.float64)
        alike = _squared(pixels, template.colors - template.core + evidence[3:, j, i], settings) < 1.0
        color = median_color(pixels[alike]) if alike.any() else np.zeros(3)
        share, around = (float(x) for x in evidence[1:3, j, i])
        return AppearanceMatch(
            center,
            _score(evidence[:, j, i], settings.ring_weight),
            share,
            around,
            tuple(color.tolist()),
            float(weighed[j, i]),
        )

    def _template(self, outline: Outline) -> _Template:
        """The median of the stored views, each transformed to the shape of an outline."""
        settings, half, shape = self._settings, _half(outline, self._settings), outline.shape_px
        key = shape.tobytes()
        if self._drawn is not None and self._drawn[0] == key:
            return self._drawn[1]
        inverse = np.asarray(np.linalg.inv(shape), dtype=np.float64)
        inside, ring = pixels_of(inverse, half, settings.margin, settings.ring_px)
        median = median_picture(np.array([view.redrawn(inverse, half) for view in self._kept]))
        colors = median[inside[:, 1] + half, inside[:, 0] + half]
        behind = median_color(median[ring[:, 1] + half, ring[:, 0] + half])
        template = _Template(inside, ring, colors, median_color(colors), behind, settings)
        self._drawn = key, template
        return template


def _weighed(
    part: Image,
    corner: tuple[int, int],
    box: tuple[int, int, int, int],
    template: _Template,
    expected: Expected,
    step: int,
    another: bool,
) -> tuple[Floats, Floats]:
    """Result of `likeness`, and values of `AppearanceMatch.weighed`, at every `step`-th position in a box.

    part: part of the picture; corner: position of its first pixel; box: u0, v0, u1, v1 in the whole picture
    another: whether the mark's colour is fitted at each position
    """
    (left, top), (u0, v0, u1, v1) = corner, box
    inside = (u0 - left, v0 - top, u1 - left, v1 - top)
    of_mark = template.inside, template.ring, template.colors, template.core
    settings = template.settings.for_kernel()
    if another:
        evidence = likeness_in_other_light(part, inside, step, *of_mark, settings)
    else:
        evidence = likeness(part, inside, *of_mark, template.behind, settings)
    (uu, uv), (_, vv) = np.linalg.inv(expected.cov_px2)
    du = np.arange(u0, u1, step) - expected.center_px[0]
    dv = (np.arange(v0, v1, step) - expected.center_px[1])[:, None]
    prior = template.settings.other_prior if another else template.settings.prior
    squared = uu * du * du + 2.0 * uv * du * dv + vv * dv * dv
    return evidence, _score(evidence, template.settings.ring_weight) - prior * squared


def _score(evidence: Floats, ring_weight: float) -> Any:
    """Scores from the evidence that `likeness` returns."""
    return evidence[0] - ring_weight * evidence[2]


def _half(outline: Outline, settings: AppearanceSettings) -> int:
    """Distance from the mark's centre to the outer edge of the ring [px]."""
    (a, b), (c, d) = outline.shape_px.tolist()
    # the longer half axis is the larger singular value, in closed form
    total = a * a + b * b + c * c + d * d
    longer = sqrt(0.5 * (total + sqrt(max(total * total - 4.0 * (a * d - b * c) ** 2, 0.0))))
    return ceil((1.0 + settings.margin) * longer + settings.ring_px + 1.0)


def _squared(pixels: Floats, colors: Floats, settings: AppearanceSettings) -> Any:
    """Squared distance of each pixel from a colour. Below 1, both are similar. pixels, colors: (n, 3) or (3,)."""
    return ((pixels - colors) ** 2 / (settings.level**2 + (settings.shade * colors) ** 2)).mean(axis=-1)


def _peak(line: Floats, k: int) -> float:
    """Position of the peak of the parabola through value k and its two neighbours, relative to k, from -0.5 to 0.5."""
    if not 0 < k < len(line) - 1:
        return 0.0
    bend = 2.0 * line[k] - line[k - 1] - line[k + 1]
    return 0.0 if bend <= 0.0 else float(np.clip(0.5 * (line[k + 1] - line[k - 1]) / bend, -0.5, 0.5))
