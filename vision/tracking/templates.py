"""Appearance models of a scene's marks, by name. They are learned from complete views and compared with detections."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from vision.arrays import Floats, Image
from vision.detection.expected import Expected
from vision.detection.records import Detection
from vision.tracking.appearance import AppearanceMatch, AppearanceModel
from vision.tracking.candidates import (
    detection_at,
    detection_in_other_light,
    fused,
    is_free,
    is_mark,
    is_mark_in_other_light,
)
from vision.tracking.settings import FINDER, FinderSettings


class AppearanceTemplates:
    """Appearance models, by name, of marks with a uniform colour and a known outline.

    A model is deleted `TemplateSettings.forget` frames after its last stored view.
    """

    def __init__(self, settings: FinderSettings = FINDER) -> None:
        self._settings = settings
        self._known: dict[str, AppearanceModel] = {}

    def __contains__(self, name: str) -> bool:
        return name in self._known

    def can_compare(self, one: Expected) -> bool:
        """Whether a mark has a uniform colour and enough pixels for an appearance model."""
        outline = one.outline
        return outline is not None and outline.even and outline.area_px >= np.pi * self._settings.min_radius_px**2

    def is_clear(self, seen: Detection) -> bool:
        """Whether a detection needs no comparison: its mark is completely visible, and its centre is accurate."""
        return not seen.occluded and not seen.clipped and _sd_px(seen) <= self._settings.templates.clear_sd_px

    def remember(self, frame_bgr: Image, seen: Detection, expected: Expected) -> None:
        """Store a view of a completely visible mark. A full model stores one view in every settings.refresh frames."""
        settings, model = self._settings.templates, self._known.get(expected.name)
        if model is not None and model.unseen < settings.refresh and model.is_full:
            return
        if seen.occluded or seen.clipped or _sd_px(seen) > settings.whole_sd_px or not self.can_compare(expected):
            return
        if model is None:
            model = self._known[expected.name] = AppearanceModel(expected.hue_deg, self._settings.appearance)
        assert expected.outline is not None
        model.remember(frame_bgr, seen.center_px, expected.outline)

    def forget(self) -> None:
        """Count a frame for each model. Delete models without a new view for over `TemplateSettings.forget` frames."""
        longest, forget = 0, self._settings.templates.forget
        for model in self._known.values():
            model.unseen += 1
            longest = max(longest, model.unseen)
        if longest > forget:
            self._known = {name: model for name, model in self._known.items() if model.unseen <= forget}

    def checked(
        self, frame_bgr: Image, one: Expected, seen: Detection, color_distance: Callable[[Detection], float]
    ) -> Detection | None:
        """Compare a detection with the best match of the mark's appearance model.

        If the detection and the match agree, the result is their weighted mean. Otherwise, the result is the one of the
        two that resembles the mark more. If neither of them resembles the mark, the result is None.
        frame_bgr: (height, width, 3) uint8
        color_distance: function such as `AdaptiveHue.distance`
        """
        quick = self._checked_near(frame_bgr, one, seen)
        if quick is not None:
            return quick
        limits = self._settings.candidates
        match = self.match(frame_bgr, one)
        if match is not None:
            if self._is_near(match, seen):
                if match.score >= limits.score or (is_free(match, limits) and match.share >= limits.free_share):
                    return fused(seen, match, limits)
            elif self._score_at(frame_bgr, one, seen) >= max(match.score, limits.score):
                return seen
            better = detection_at(match, one, limits)
            if is_mark(match, color_distance(better), limits):
                return better
        return self._checked_in_other_light(frame_bgr, one, seen, color_distance)

    def _checked_in_other_light(
        self, frame_bgr: Image, one: Expected, seen: Detection, color_distance: Callable[[Detection], float]
    ) -> Detection | None:
        match = self.match_in_other_light(frame_bgr, one)
        if _sd_px(seen) <= self._settings.templates.unknown_sd_px and (match is None or self._is_near(match, seen)):
            return seen
        return None if match is None else self.mark_in_other_light(frame_bgr, one, match, color_distance)

    def mark_in_other_light(
        self, frame_bgr: Image, one: Expected, match: AppearanceMatch, color_distance: Callable[[Detection], float]
    ) -> Detection | None:
        """Detection at a match that `match_in_other_light` found; None if the match is not similar enough to the mark.

        frame_bgr: (height, width, 3) uint8; color_distance: as in `checked`
        """
        limits = self._settings.candidates
        if not is_mark_in_other_light(match, color_distance(detection_at(match, one, limits)), limits):
            return None
        return detection_in_other_light(frame_bgr, match, one, self._settings)

    def match(
        self, frame_bgr: Image, one: Expected, about_px: Floats | None = None, within_px: float | None = None
    ) -> AppearanceMatch | None:
        """The best match of the mark's appearance model, see `AppearanceModel.place`; None without a model."""
        model = self._known.get(one.name)
        return None if model is None else model.place(frame_bgr, one, about_px, within_px=within_px)

    def match_in_other_light(self, frame_bgr: Image, one: Expected) -> AppearanceMatch | None:
        """The best match of the models of all marks of this mark's hue. The colour is fitted at each position."""
        models = [model for model in self._known.values() if model.hue_deg == one.hue_deg]
        matches = [model.place(frame_bgr, one, another=True) for model in models]
        return max((match for match in matches if match is not None), key=lambda match: match.weighed, default=None)

    def _checked_near(self, frame_bgr: Image, one: Expected, seen: Detection) -> Detection | None:
        """Result of `checked` from matches near the detection; None if matches elsewhere must be searched, too."""
        settings = self._settings.templates
        if one.name not in self._known:
            return seen if not seen.occluded and _sd_px(seen) <= settings.whole_sd_px else None
        match = self.match(frame_bgr, one, seen.center_px, settings.near_px + 1.0)
        if match is None or match.score < settings.plain_score or not self._is_near(match, seen):
            return None
        return fused(seen, match, self._settings.candidates)

    def _score_at(self, frame_bgr: Image, one: Expected, seen: Detection) -> float:
        """Score of the mark's appearance at the position of a detection."""
        there = replace(one, center_px=seen.center_px, cov_px2=np.eye(2))
        match = self.match(frame_bgr, there, seen.center_px, 0.0)
        return -np.inf if match is None else match.score

    def _is_near(self, match: AppearanceMatch, seen: Detection) -> bool:
        return float(np.hypot(*(match.center_px - seen.center_px))) <= self._settings.templates.near_px


def _sd_px(seen: Detection) -> float:
    (uu, _), (_, vv) = seen.cov_px2.tolist()
    return float(max(uu, vv)) ** 0.5
