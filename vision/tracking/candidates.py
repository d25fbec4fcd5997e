"""From places that look like a mark to marks: whether it is one, where its centre is, and how well that is known."""

from __future__ import annotations

from collections.abc import Callable
from math import exp

import numpy as np

from vision.arrays import Floats, Image
from vision.detection.expected import Expected
from vision.detection.records import Detection
from vision.detection.rim import fit_rim
from vision.detection.settings import DetectionSettings
from vision.tracking.appearance import AppearanceMatch
from vision.tracking.settings import FINDER, CandidateSettings, FinderSettings


def is_mark(place: AppearanceMatch, free_score: float, settings: CandidateSettings) -> bool:
    """Whether a place is a mark of known looks; free_score: what it needs where nothing around it looks like it."""
    if place.around < settings.free:
        return place.score >= free_score and place.share >= settings.free_share
    return place.score >= settings.score and place.share >= settings.share


def missed_mark(
    place: AppearanceMatch,
    one: Expected,
    off: Callable[[Detection], float],
    settings: CandidateSettings = FINDER.candidates,
) -> Detection | None:
    """A mark of known looks that nothing else found; off: how far a colour is off its kind's, as `FollowedHue.off`."""
    if not is_mark(place, settings.score, settings) or (
        place.score < settings.doubtful_score and place.around > settings.doubtful
    ):
        return None
    seen = seen_at(place, one, settings)
    return seen if place.score >= settings.sure_score or off(seen) <= 1.0 else None


def mark_in_other_light(
    frame_bgr: Image,
    place: AppearanceMatch,
    one: Expected,
    off: Callable[[Detection], float],
    settings: FinderSettings = FINDER,
) -> Detection | None:
    """A mark whose colour was not known, where it is even and apart from what is around it: by its rim, too.

    frame_bgr: (height, width, 3); off: as for `missed_mark`
    """
    limits = settings.candidates
    seen = seen_at(place, one, limits, (limits.other_score, limits.other_growth))
    off_hue = off(seen)
    even_score, apart_score = limits.even_sure_score, limits.apart_sure_score
    if off_hue <= 1.0:
        even_score, apart_score = limits.even_score, limits.apart_score
    apart = place.around <= limits.apart and place.share >= limits.apart_share and place.score >= apart_score
    even = place.around <= limits.even_around and place.share >= limits.even_share and place.weighed >= even_score
    if off_hue > limits.max_off or not (apart or even):
        return None
    rim = _rim(frame_bgr, place, one, settings.detection)
    away = np.inf if rim is None else float(np.hypot(*(rim - place.center_px)))
    if rim is None or away > limits.max_rim_px:
        return seen
    variance = _sd(place, (limits.rim_score, limits.rim_growth), limits) ** 2 + (limits.rim_off * away) ** 2
    return _moved(seen, (place.center_px + rim) / 2.0, variance * np.eye(2))


def seen_at(
    place: AppearanceMatch,
    one: Expected,
    settings: CandidateSettings = FINDER.candidates,
    sd: tuple[float, float] | None = None,
) -> Detection:
    """A mark at a place; sd: score and growth that its standard deviation [px] follows, else of known appearance."""
    assert one.outline is not None
    sd = (settings.known_score, settings.known_growth) if sd is None else sd
    area = place.share * one.outline.area_px
    return Detection(
        place.center_px, _sd(place, sd, settings) ** 2 * np.eye(2), area, one.hue_deg, False, True, place.color_bgr
    )


def together(seen: Detection, place: AppearanceMatch, settings: CandidateSettings = FINDER.candidates) -> Detection:
    """What was found, its centre and that of the place that looks like it [px] weighed by their covariances [px²]."""
    variance = _sd(place, (settings.known_score, settings.known_growth), settings) ** 2
    gain = seen.cov_px2 @ np.linalg.inv(seen.cov_px2 + variance * np.eye(2))
    center = seen.center_px + gain @ (place.center_px - seen.center_px)
    return _moved(seen, center, settings.shared * variance * gain)


def _moved(seen: Detection, center_px: Floats, cov_px2: Floats) -> Detection:
    return Detection(
        center_px, cov_px2, seen.area_px, seen.hue_deg, seen.clipped, seen.covered, seen.color_bgr, seen.size
    )


def _sd(place: AppearanceMatch, by_score: tuple[float, float], settings: CandidateSettings) -> float:
    """Standard deviation of the centre of a place [px]."""
    best, growth = by_score
    return min(settings.min_sd_px * exp(growth * max(best - place.score, 0.0)), settings.max_sd_px)


def _rim(frame_bgr: Image, place: AppearanceMatch, one: Expected, settings: DetectionSettings) -> Floats | None:
    """The centre of the rim about a place [px], (2,); None where there is none."""
    assert one.outline is not None
    reach = int(2.0 * (one.outline.area_px / np.pi) ** 0.5 + 8.0)
    u, v = (round(float(x)) for x in place.center_px)
    corner = np.array([max(u - reach, 0), max(v - reach, 0)])
    patch = np.ascontiguousarray(frame_bgr[corner[1] : v + reach + 1, corner[0] : u + reach + 1])
    if min(patch.shape[:2]) < reach:
        return None
    rim = fit_rim(patch, np.array([[*(place.center_px - corner), 1.0]]), one.outline, settings)
    return None if rim is None else np.asarray(rim.center_px + corner, dtype=np.float64)
