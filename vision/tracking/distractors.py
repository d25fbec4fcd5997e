"""Distractors: new objects in a mark's colour that are not marks, such as blood, a glove or a red cloth."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, pi

import cv2
import numpy as np

from vision.arrays import Floats, Image, Picture
from vision.detection import kernels
from vision.detection.expected import Expected
from vision.detection.hue import MarkHue
from vision.detection.palette import Palette, equal, palette_of
from vision.detection.records import Detection
from vision.tracking.settings import FINDER, DistractorSettings

SQUARE_2 = np.ones((2, 2), np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Distractor:
    """A new object in the picture that has the colour of marks but is not a mark.

    hue_deg: nominal hue of the marks with this colour; like: name of the nearest of these marks
    center_px: centre of the object's largest connected part [px], (2,)
    size: area of the object, relative to the area of a mark [1]
    """

    hue_deg: float
    like: str
    center_px: Floats
    size: float


@dataclass(slots=True, eq=False)
class _Level:
    """Areas of objects in a mark's hue, as numbers of sampled pixels outside the marks.

    of_late: area of all objects in each of the last `DistractorSettings.stands` frames; n_seen: number of frames so far
    known: area of known objects; reported: area of new objects in the last report
    """

    of_late: deque[float]
    known: float = 0.0
    n_seen: int = 0
    reported: float = 0.0


class DistractorWatch:
    """Reports each new or growing object in a mark's colour once, if its area is comparable to the area of a mark.

    To save time, only a few pixels per mark diameter are examined. Known objects are not reported. An object is known
    if it is in the first frames, or if it has a mark's colour only because the colour range was adapted. While a mark
    is missing, no object of its hue is reported, because the object may be the mark.
    """

    def __init__(self, settings: DistractorSettings = FINDER.distractors) -> None:
        self._settings = settings
        self._hues: tuple[MarkHue, ...] = ()
        self._levels: dict[float, _Level] = {}

    def update(
        self,
        frame_bgr: Image,
        hues: Mapping[float, MarkHue],
        expected: Sequence[Expected],
        found: Mapping[str, Detection],
    ) -> tuple[Distractor, ...]:
        """Search a frame for distractors. Returns the new and the grown ones.

        hues: present colour range of each kind of mark, by nominal hue
        expected: all marks; found: detections of the found marks by name
        """
        radii = [_radius_px(one) for one in expected]
        if not radii or None in radii:
            return ()
        sizes = [radius for radius in radii if radius is not None]
        step = self._step(frame_bgr, min(sizes))
        part = np.ascontiguousarray(frame_bgr[::step, ::step])
        free = self._away_from_marks(part.shape[:2], step, expected, sizes, found)
        now = tuple(hues.values())
        counted = _counted(part, free, now)
        before = counted if self._hues in ((), now) else _counted(part, free, self._hues)
        self._hues = now
        distractors = []
        for k, hue_deg in enumerate(hues):
            own = [(one, size) for one, size in zip(expected, sizes, strict=True) if one.hue_deg == hue_deg]
            level = self._levels.setdefault(hue_deg, _Level(deque(maxlen=self._settings.stands)))
            level.known += float(np.count_nonzero(counted[k])) - float(np.count_nonzero(before[k]))
            if not own or any(one.name not in found for one, _ in own):
                level.of_late.clear()
                continue
            mark = pi * (min(size for _, size in own) / step) ** 2
            if self._comes(level, float(np.count_nonzero(counted[k])), mark):
                share = level.reported / mark
                distractors.append(self._distractor(hue_deg, [one for one, _ in own], counted[k], step, share))
        return tuple(distractors)

    def _step(self, frame_bgr: Image, radius_px: float) -> int:
        """Distance between sampled pixels [px]. radius_px: radius of the smallest mark."""
        s, (height, width) = self._settings, frame_bgr.shape[:2]
        return max(1, int(s.spacing * radius_px), ceil((height * width / s.most_samples) ** 0.5))

    def _away_from_marks(
        self,
        shape: tuple[int, ...],
        step: int,
        expected: Sequence[Expected],
        sizes: Sequence[float],
        found: Mapping[str, Detection],
    ) -> Picture:
        free = np.ones(shape, np.uint8)
        for one, size in zip(expected, sizes, strict=True):
            center = found[one.name].center_px if one.name in found else one.center_px
            u, v = (round(float(x) / step) for x in center)
            if abs(u) + abs(v) < 1_000_000:  # an expected position may be far outside the picture
                cv2.circle(free, (u, v), ceil(self._settings.around * size / step), 0, -1)
        return free

    def _comes(self, level: _Level, n: float, mark: float) -> bool:
        """Whether to report new objects. n: area of all objects; mark: area of a mark; both in sampled pixels."""
        s = self._settings
        level.of_late.append(n)
        level.n_seen += 1
        if level.n_seen <= s.settled_frames:
            level.known = max(level.known, n)
            return False
        if len(level.of_late) < s.stands:
            return False
        least, most = min(level.of_late), max(level.of_late)
        if most < level.known + s.least * mark:
            level.reported = 0.0
            level.known = most if most < level.known - s.least * mark else level.known
        if least - level.known < max(s.least * mark, s.grows * level.reported, s.wavers * level.known):
            return False
        level.reported = least - level.known
        return True

    @staticmethod
    def _distractor(hue_deg: float, own: Sequence[Expected], counted: Picture, step: int, size: float) -> Distractor:
        _, _, stats, centers = cv2.connectedComponentsWithStats(counted, connectivity=8)
        largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
        center_px = step * centers[largest]
        like = min(own, key=lambda one: float(np.hypot(*(one.center_px - center_px))))
        return Distractor(hue_deg, like.name, center_px, size)


def _radius_px(one: Expected) -> float | None:
    return None if one.outline is None else (one.outline.area_px / pi) ** 0.5


def _counted(part: Picture, free: Picture, hues: tuple[MarkHue, ...]) -> list[Picture]:
    """For each hue, mask of the sampled pixels of this hue: 1, else 0, (h, w) uint8. Isolated pixels are removed."""
    palette: Palette = palette_of(hues)
    classes = np.empty(part.shape[:2], np.uint8)
    kernels.classify(part, palette.table, palette.least_value, palette.least_saturation, classes)
    classes *= free
    return [_hanging_together(equal(classes, number)) for number in range(1, len(hues) + 1)]


def _hanging_together(samples: Picture) -> Picture:
    """Mask of the set pixels that lie in a completely set block of 2 x 2 pixels."""
    return np.asarray(cv2.morphologyEx(samples, cv2.MORPH_OPEN, SQUARE_2)) if cv2.countNonZero(samples) else samples
