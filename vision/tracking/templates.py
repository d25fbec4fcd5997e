"""Marks that are partly covered, or missing, compared with how they looked before."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vision.arrays import Floats, Image
from vision.detection.expected import Expected
from vision.detection.records import Detection
from vision.tracking.appearance import AppearanceMatch, AppearanceModel
from vision.tracking.association import AssociatedMark
from vision.tracking.candidates import (
    is_mark,
    mark_in_other_light,
    missed_mark,
    seen_at,
    together,
)
from vision.tracking.settings import FINDER, FinderSettings


class AppearanceTemplates:
    """What the marks of a scene looked like, by name, those of one even colour whose outline is known.

    State: an appearance for each that was clearly seen in the last FORGOTTEN frames.
    """

    def __init__(self, settings: FinderSettings = FINDER) -> None:
        self._settings = settings
        self._known: dict[str, AppearanceModel] = {}

    def __contains__(self, name: str) -> bool:
        return name in self._known

    def compared(
        self,
        frame_bgr: Image,
        expected: Sequence[Expected],
        found: Sequence[AssociatedMark],
        off: Callable[[Detection], float],
    ) -> list[AssociatedMark]:
        """The marks found, put right or left out where the picture does not look like them, and those missed.

        off: how far a detection's colour is off that of its kind, squared, by how far it may be
        """
        where = {one.name: one for one in expected}
        kept: list[AssociatedMark] = []
        odd: list[AssociatedMark] = []
        for one in found:
            clear = self._is_clear(one.detection)
            (kept if clear or not self._is_even(where[one.name]) else odd).append(one)
            if clear:
                self._remember(frame_bgr, one, where[one.name])
        for one in odd:
            better = self._checked(frame_bgr, where[one.name], one.detection, off)
            if better is not None:
                kept.append(AssociatedMark(one.name, better))
                if better.covered == one.detection.covered:
                    # by its outline alone: with the place that looks like it, looks would learn their own errors
                    self._remember(frame_bgr, one, where[one.name])
        names = {one.name for one in found}
        for each in expected:
            seen = None if each.name in names else self._sought(frame_bgr, each, off)
            if seen is not None and all(self._apart(seen, other.detection) for other in kept):
                kept.append(AssociatedMark(each.name, seen))
        self._forget()
        return kept

    def _remember(self, frame_bgr: Image, one: AssociatedMark, expected: Expected) -> None:
        settings = self._settings.templates
        seen, look = one.detection, self._known.get(one.name)
        if look is not None and look.unseen < settings.refresh and look.is_full:
            return
        if seen.covered or seen.clipped or _variance(seen) > settings.whole_sd_px**2 or not self._is_even(expected):
            return
        if look is None:
            look = self._known[one.name] = AppearanceModel(expected.hue_deg, self._settings.appearance)
        assert expected.outline is not None
        look.remember(frame_bgr, seen.center_px, expected.outline)

    def _forget(self) -> None:
        longest, forget = 0, self._settings.templates.forget
        for look in self._known.values():
            look.unseen += 1
            longest = max(longest, look.unseen)
        if longest > forget:
            self._known = {name: look for name, look in self._known.items() if look.unseen <= forget}

    def _sought(self, frame_bgr: Image, one: Expected, off: Callable[[Detection], float]) -> Detection | None:
        """A mark that is missing, where the picture looks like it."""
        if not self._is_even(one):
            return None
        place = self._place(frame_bgr, one)
        seen = None if place is None else missed_mark(place, one, off, self._settings.candidates)
        if seen is not None:
            return seen
        place = self._best_in_other_light(frame_bgr, one)
        return None if place is None else mark_in_other_light(frame_bgr, place, one, off, self._settings)

    def _checked(
        self, frame_bgr: Image, one: Expected, seen: Detection, off: Callable[[Detection], float]
    ) -> Detection | None:
        """What was found, where the picture looks like the mark; or the mark where it does; None where nowhere."""
        settings, limits = self._settings.templates, self._settings.candidates
        plain = self._plainly_it(frame_bgr, one, seen)
        if plain is not None:
            return plain
        place = self._place(frame_bgr, one, seen.center_px)
        if place is not None and _variance(seen) <= settings.worthless_sd_px**2:
            if self._near(place, seen) and np.isfinite(place.there):
                alone = place.around < limits.free and place.share >= limits.free_share
                if alone or (place.score >= settings.near_score and place.around <= settings.merged):
                    return together(seen, place, limits)
            elif self._score_there(frame_bgr, one, seen, place) >= max(
                place.score - settings.as_good, settings.near_score
            ):
                return seen
        if (
            place is not None
            and is_mark(place, limits.free_score, limits)
            and off(better := seen_at(place, one, limits)) <= 1.0
        ):
            return better
        place = self._best_in_other_light(frame_bgr, one)
        if _variance(seen) <= settings.unknown_sd_px**2 and (place is None or self._near(place, seen)):
            return seen
        return None if place is None else mark_in_other_light(frame_bgr, place, one, off, self._settings)

    def _plainly_it(self, frame_bgr: Image, one: Expected, seen: Detection) -> Detection | None:
        """What was found, where that is clear at once: the usual case in noise, and the quicker."""
        settings = self._settings.templates
        if one.name not in self._known:
            return seen if not seen.covered and _variance(seen) <= settings.whole_sd_px**2 else None
        place = self._place(frame_bgr, one, seen.center_px, settings.near_px + 1.0)
        if place is None or place.score < settings.plain_score or not self._near(place, seen):
            return None
        if _variance(seen) > settings.worthless_sd_px**2:
            return None
        return together(seen, place, self._settings.candidates)

    def _best_in_other_light(self, frame_bgr: Image, one: Expected) -> AppearanceMatch | None:
        """Where it looks most like a mark of this kind, in whatever light."""
        looks = [look for look in self._known.values() if look.hue_deg == one.hue_deg]
        places = [look.place(frame_bgr, one, another=True) for look in looks]
        return max((place for place in places if place is not None), key=lambda place: place.weighed, default=None)

    def _place(
        self, frame_bgr: Image, one: Expected, there_px: Floats | None = None, within_px: float | None = None
    ) -> AppearanceMatch | None:
        """Where it looks like this mark as it was."""
        look = self._known.get(one.name)
        return None if look is None else look.place(frame_bgr, one, there_px, within_px=within_px)

    def _score_there(self, frame_bgr: Image, one: Expected, seen: Detection, best: AppearanceMatch) -> float:
        """How much the place of something looks like the mark, though it be further away than was looked."""
        if np.isfinite(best.there):
            return best.there
        there = self._place(frame_bgr, replace(one, center_px=seen.center_px, cov_px2=np.eye(2)))
        return -np.inf if there is None else there.score

    def _is_even(self, one: Expected) -> bool:
        """Whether a mark is of one colour and has pixels enough to look like something."""
        return (
            one.outline is not None
            and one.outline.even
            and one.outline.area_px >= np.pi * self._settings.min_radius_px**2
        )

    def _is_clear(self, seen: Detection) -> bool:
        """Whether this is a whole mark, beyond doubt."""
        return not seen.covered and not seen.clipped and _variance(seen) <= self._settings.templates.clear_sd_px**2

    def _near(self, place: AppearanceMatch, seen: Detection) -> bool:
        return float(np.hypot(*(place.center_px - seen.center_px))) <= self._settings.templates.near_px

    def _apart(self, a: Detection, b: Detection) -> bool:
        """Whether two detections are of different marks."""
        return float(np.hypot(*(a.center_px - b.center_px))) > self._settings.detection.coverage.pad_px


def _variance(seen: Detection) -> float:
    (uu, _), (_, vv) = seen.cov_px2.tolist()
    return max(uu, vv)
