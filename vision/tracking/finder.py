"""The marks of one scene, frame after frame: searched where they are expected, named, and their colours followed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields
from itertools import combinations
from math import ceil, floor, hypot

import numpy as np

from vision.arrays import Floats, Image
from vision.detection.components import detect_marks
from vision.detection.expected import Expected
from vision.detection.fast_path import detect_isolated
from vision.detection.hue import MarkHue
from vision.detection.outline import Outline
from vision.detection.records import Detection, HueError
from vision.detection.rim_search import detect_by_rim
from vision.tracking.association import AssociatedMark, associate_marks, squared_distance
from vision.tracking.hue_tracking import AdaptiveHue
from vision.tracking.settings import FINDER, REACH_SDS, FinderSettings
from vision.tracking.templates import AppearanceTemplates

Box = tuple[int, int, int, int]


class MarkFinder:
    """Finds marks by their hue and names them by where they are expected.

    hues: of the marks, by the nominal hue that `Expected` bears
    Frames are searched around the expected places only, and wholly at the start and when a mark is missing.
    State: colours as followed; what marks looked like; the names of those missed in the last frame, None before the
    first.
    """

    def __init__(self, hues: Iterable[MarkHue], settings: FinderSettings | None = None) -> None:
        self.settings = settings = FINDER if settings is None else settings
        self.hues = {hue.hue_deg: AdaptiveHue(hue, settings.hue) for hue in _of_one_range(hues)}
        self.missed: set[str] | None = None
        self._looks = AppearanceTemplates(settings)

    def find(
        self,
        frame_bgr: Image,
        expected: Sequence[Expected],
        expected_after_impulse: Callable[[str], Expected] | None = None,
    ) -> list[AssociatedMark]:
        """The marks seen, in no order; one that is not seen is absent.

        frame_bgr: (height, width, 3) uint8
        expected: where each mark is expected
        struck: the same for one mark by its name, were it struck since it was last seen
        """
        found: list[AssociatedMark] = []
        if self.missed is not None and not self.missed:
            regions = _regions(expected, frame_bgr.shape[:2], self.settings)
            if (
                sum(width * height for _, _, width, height in regions)
                < self.settings.max_regions * frame_bgr[..., 0].size
            ):
                found = self._near(frame_bgr, expected, regions)
        if len(found) < len(expected):
            found = self._anywhere(self._in_all(frame_bgr, expected), expected, expected_after_impulse)
        found = self._looks.compared(frame_bgr, expected, found, lambda seen: self.hues[seen.hue_deg].off(seen))
        if len(found) < len(expected):
            found += self._by_rim(frame_bgr, expected, found)
        found = _certain(found, expected, self.settings.association.ambiguity)
        self.missed = {one.name for one in expected} - {one.name for one in found}
        for nominal, followed in self.hues.items():
            followed.follow([f.detection for f in found if f.detection.hue_deg == nominal])
        return found

    def _by_rim(
        self, frame_bgr: Image, expected: Sequence[Expected], found: Sequence[AssociatedMark]
    ) -> list[AssociatedMark]:
        """Marks that are missing and of unknown looks, where a rim of their colour is about where they are expected."""
        names = {f.name for f in found}
        missing = [one for one in expected if one.name not in names and one.name not in self._looks]
        if not missing:
            return []
        seen = [
            d
            for one in missing
            if (d := detect_by_rim(frame_bgr, one, self.settings.detection)) is not None
            and self.hues[d.hue_deg].fits(d)
        ]
        taken = [f.detection.center_px for f in found]
        apart = [
            d
            for d in seen
            if all(np.hypot(*(d.center_px - place)) > self.settings.detection.coverage.pad_px for place in taken)
        ]
        return associate_marks(apart, missing, gate=self.settings.association.gate)

    def _in_all(self, frame_bgr: Image, expected: Sequence[Expected]) -> list[Detection]:
        """What is found in all of the picture; nothing where a hand before the camera takes most of it.

        Raises HueError where a hue takes most of the picture and no mark was ever found: then the range is wrong.
        """
        try:
            return self._detected(frame_bgr, expected, None)
        except HueError:
            if self.missed is None:
                raise
            return []

    def _anywhere(
        self,
        detections: Sequence[Detection],
        expected: Sequence[Expected],
        expected_after_impulse: Callable[[str], Expected] | None,
    ) -> list[AssociatedMark]:
        """The marks among the detections, looked for where they are expected, and what is missing as if struck."""
        gates = self.settings.association
        found = associate_marks(detections, expected, gate=gates.gate)
        if expected_after_impulse is None:
            return found
        names = {f.name for f in found}
        missing = [one.name for one in expected if one.name not in names]
        left = [d for d in detections if not any(d is f.detection for f in found)]
        if len(left) <= len(missing):
            # nothing else could be the mark
            return found + associate_marks(left, [expected_after_impulse(name) for name in missing], gate=gates.gate)
        missing = [name for name in missing if self.missed is not None and name in self.missed]
        return found + associate_marks(
            left, [expected_after_impulse(name) for name in missing], gate=gates.impulse_gate
        )

    def _near(self, frame_bgr: Image, expected: Sequence[Expected], regions: Sequence[Box]) -> list[AssociatedMark]:
        """The marks in these parts of the picture, of which none overlap."""
        hues = [followed.now for followed in self.hues.values()]
        found: list[AssociatedMark] = []
        unclear: list[Detection] = []
        for region in regions:
            own = [one for one in expected if _inside(one.center_px, region)]
            alone = detect_isolated(frame_bgr, hues, region, own[0], self.settings.detection) if len(own) == 1 else None
            # alone in a part of its own: whose mark it is, is no question
            if (
                alone is not None
                and self.hues[alone.hue_deg].fits(alone)
                and squared_distance(own[0], alone) <= self.settings.association.gate
            ):
                found.append(AssociatedMark(own[0].name, alone))
            else:
                unclear += self._detected(frame_bgr, expected, region)
        if not unclear:
            return found
        names = {f.name for f in found}
        return found + associate_marks(
            unclear, [one for one in expected if one.name not in names], gate=self.settings.association.gate
        )

    def _detected(self, frame_bgr: Image, expected: Sequence[Expected], region: Box | None) -> list[Detection]:
        own = [one for one in expected if region is None or _inside(one.center_px, region)]
        outlines, min_area_px, max_area_px = _looks(own, self.settings)
        detections = detect_marks(
            frame_bgr,
            [followed.now for followed in self.hues.values()],
            min_area_px=min_area_px,
            max_area_px=max_area_px,
            region=region,
            outlines=outlines,
            expected_px=[one.center_px for one in own],
            expected_hues=[one.hue_deg for one in own],
            settings=self.settings.detection,
        )
        return [d for d in detections if self.hues[d.hue_deg].fits(d)]


def _of_one_range(hues: Iterable[MarkHue]) -> list[MarkHue]:
    """Each hue once; raises HueError where marks of one hue differ in what counts as their colour."""
    known: dict[float, MarkHue] = {}
    for hue in hues:
        other = known.setdefault(hue.hue_deg, hue)
        for key in (field.name for field in fields(MarkHue)):
            own, first = getattr(hue, key), getattr(other, key)
            if own != first:
                raise HueError(
                    f"marks of hue {hue.hue_deg:g} degrees: expected one {key} for all of them, found {first} and {own}"
                    "; give all the same, or hues that differ"
                )
    return list(known.values())


def _certain(found: Sequence[AssociatedMark], expected: Sequence[Expected], ambiguity: float) -> list[AssociatedMark]:
    """Without those that touch another of their hue and might as well be it: better unseen than swapped."""
    where = {one.name: one for one in expected}
    sizes = {one.name: 0.0 if one.outline is None else (one.outline.area_px / np.pi) ** 0.5 for one in expected}
    places = {one.name: one.center_px.tolist() for one in expected}
    doubtful: set[str] = set()
    for a, b in combinations(found, 2):
        (u, v), (other_u, other_v) = places[a.name], places[b.name]
        if abs(u - other_u) + abs(v - other_v) > 1.5 * (sizes[a.name] + sizes[b.name]):
            continue
        one, other = where[a.name], where[b.name]
        if one.hue_deg != other.hue_deg or hypot(u - other_u, v - other_v) > sizes[a.name] + sizes[b.name]:
            continue
        named = squared_distance(one, a.detection) + squared_distance(other, b.detection)
        swapped = squared_distance(one, b.detection) + squared_distance(other, a.detection)
        if swapped - named < ambiguity:
            doubtful |= {a.name, b.name}
    return [one for one in found if one.name not in doubtful]


def _looks(marks: Sequence[Expected], settings: FinderSettings) -> tuple[list[Outline], float, float | None]:
    """What each of these marks looks like, where that is known and tells something, and the area of one [px].

    Least and largest, the latter of two that touch where outlines can part them.
    """
    outlines = [one.outline for one in marks if one.outline is not None]
    if len(outlines) < len(marks) or not outlines:
        return [], 1.0, None
    areas = [one.area_px for one in outlines]
    if min(areas) < np.pi * settings.min_radius_px**2:
        return [], settings.min_area * min(areas), settings.max_area * max(areas)
    even = all(one.even for one in outlines)
    return outlines, settings.min_seen * min(areas), len(marks) * settings.max_area * max(areas) if even else None


def _inside(place_px: Floats, region: Box) -> bool:
    left, top, width, height = region
    return left <= place_px[0] < left + width and top <= place_px[1] < top + height


def _regions(expected: Sequence[Expected], shape: tuple[int, ...], settings: FinderSettings) -> list[Box]:
    """Left, top, width, height of the parts of a picture, (height, width), where marks are expected; none overlap."""
    boxes = []
    pad_px = settings.detection.coverage.pad_px + 4
    for one in expected:
        (u, v), ((uu, _), (_, vv)) = one.center_px.tolist(), one.cov_px2.tolist()
        (a, b), (c, d) = ((0.0, 0.0), (0.0, 0.0)) if one.outline is None else one.outline.shape_px.tolist()
        across = REACH_SDS * uu**0.5 + 1.3 * hypot(a, b) + pad_px
        down = REACH_SDS * vv**0.5 + 1.3 * hypot(c, d) + pad_px
        low = max(floor(u - across), 0), max(floor(v - down), 0)
        high = min(ceil(u + across) + 1, shape[1]), min(ceil(v + down) + 1, shape[0])
        if high[0] > low[0] and high[1] > low[1]:
            boxes.append((*low, *high))
    overlapping = any(_overlap(a, b) for a, b in combinations(boxes, 2))
    apart: list[tuple[int, int, int, int]] = [] if overlapping else boxes
    for box in boxes if overlapping else ():
        merged = box
        while (other := next((one for one in apart if _overlap(one, merged)), None)) is not None:
            apart.remove(other)
            merged = (*map(min, other[:2], merged[:2]), *map(max, other[2:], merged[2:]))
        apart.append(merged)
    return [(u0, v0, u1 - u0, v1 - v0) for u0, v0, u1, v1 in apart]


def _overlap(a: tuple[int, int, int, int], b: tuple[int, int, int, int]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
