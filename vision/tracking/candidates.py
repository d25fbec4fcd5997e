"""From places that look like a mark to marks: whether it is one, where its centre is, and how well that is known."""

from __future__ import annotations

from collections.abc import Callable
from math import exp

import numpy as np

from vision.arrays import Floats, Image
from vision.detection.expected import Expected
from vision.detection.records import Detection
from vision.detection.rim import fit_rim
from vision.tracking.appearance import AppearanceMatch

SCORE, SHARE = 0.55, 0.7
"""Score, and share of its pixels, from which on a place that looks like a mark is one; chosen."""
FREE, FREE_SHARE, FREE_SCORE = -0.9, 0.3, 0.4
"""Where nothing around it looks like it, less of it may be seen, and of a mark that was found it may look less so."""
DOUBTFUL, DOUBTFUL_SCORE = 0.3, 0.75
"""A missing mark needs this score where more around it looks like it; chosen."""
SURE_SCORE = 0.7
"""Score from which on a place is the mark whatever its colour; chosen."""

EVEN_SHARE, EVEN_AROUND, EVEN_SCORE, EVEN_SURE_SCORE = 0.8, -0.2, 0.75, 1.0
"""The same where its light was not known: its share at least, what is around it at most, and its score less what it
loses by its distance at least, the latter whatever its colour; chosen."""
FURTHEST_OFF = 2.0
"""How far its colour may then be off, squared, by how far that of a mark may be; chosen."""
APART, APART_SHARE, APART_SCORE, APART_SURE_SCORE = -0.95, 0.4, 0.65, 0.85
"""And where nothing around it looks like it; chosen."""

LEAST_SD_PX, MOST_SD_PX = 0.27, 1.2
"""Standard deviation of the centre of a place, at least and at most; measured on drawn frames, as what follows."""
KNOWN_SD, RIM_SD, OTHER_SD = (1.35, 2.6), (1.25, 2.5), (1.4, 4.0)
"""Score up to which it is the least, and how fast it grows below, exponentially: of a mark of known looks; in other
light, with its rim; and without."""
FURTHEST_RIM_PX, RIM_OFF = 3.0, 0.35
"""How far from the place its rim may be, and what that adds to the standard deviation of their mean, by how far."""
TOGETHER = 1.6
"""What a centre by outline and a place have in common makes the variance of their mean so much larger; measured."""


def is_mark(place: AppearanceMatch, free_score: float) -> bool:
    """Whether a place is a mark of known looks; free_score: what it needs where nothing around it looks like it."""
    if place.around < FREE:
        return place.score >= free_score and place.share >= FREE_SHARE
    return place.score >= SCORE and place.share >= SHARE


def missed_mark(place: AppearanceMatch, one: Expected, off: Callable[[Detection], float]) -> Detection | None:
    """A mark of known looks that nothing else found; off: how far a colour is off its kind's, as `FollowedHue.off`."""
    if not is_mark(place, SCORE) or (place.score < DOUBTFUL_SCORE and place.around > DOUBTFUL):
        return None
    seen = seen_at(place, one)
    return seen if place.score >= SURE_SCORE or off(seen) <= 1.0 else None


def mark_in_other_light(
    frame_bgr: Image, place: AppearanceMatch, one: Expected, off: Callable[[Detection], float]
) -> Detection | None:
    """A mark whose colour was not known, where it is even and apart from what is around it: by its rim, too.

    frame_bgr: (height, width, 3); off: as for `missed_mark`
    """
    seen = seen_at(place, one, OTHER_SD)
    off_hue = off(seen)
    even_score, apart_score = (EVEN_SCORE, APART_SCORE) if off_hue <= 1.0 else (EVEN_SURE_SCORE, APART_SURE_SCORE)
    apart = place.around <= APART and place.share >= APART_SHARE and place.score >= apart_score
    even = place.around <= EVEN_AROUND and place.share >= EVEN_SHARE and place.weighed >= even_score
    if off_hue > FURTHEST_OFF or not (apart or even):
        return None
    rim = _rim(frame_bgr, place, one)
    away = np.inf if rim is None else float(np.hypot(*(rim - place.center_px)))
    if rim is None or away > FURTHEST_RIM_PX:
        return seen
    variance = _sd(place, RIM_SD) ** 2 + (RIM_OFF * away) ** 2
    return _moved(seen, (place.center_px + rim) / 2.0, variance * np.eye(2))


def seen_at(place: AppearanceMatch, one: Expected, sd: tuple[float, float] = KNOWN_SD) -> Detection:
    """A mark at a place; sd: score and growth that its standard deviation [px] follows, as KNOWN_SD."""
    assert one.outline is not None
    area = place.share * one.outline.area_px
    return Detection(place.center_px, _sd(place, sd) ** 2 * np.eye(2), area, one.hue_deg, False, True, place.color_bgr)


def together(seen: Detection, place: AppearanceMatch) -> Detection:
    """What was found, its centre and that of the place that looks like it [px] weighed by their covariances [px²]."""
    variance = _sd(place, KNOWN_SD) ** 2
    gain = seen.cov_px2 @ np.linalg.inv(seen.cov_px2 + variance * np.eye(2))
    center = seen.center_px + gain @ (place.center_px - seen.center_px)
    return _moved(seen, center, TOGETHER * variance * gain)


def _moved(seen: Detection, center_px: Floats, cov_px2: Floats) -> Detection:
    return Detection(
        center_px, cov_px2, seen.area_px, seen.hue_deg, seen.clipped, seen.covered, seen.color_bgr, seen.size
    )


def _sd(place: AppearanceMatch, by_score: tuple[float, float]) -> float:
    """Standard deviation of the centre of a place [px]."""
    best, growth = by_score
    return min(LEAST_SD_PX * exp(growth * max(best - place.score, 0.0)), MOST_SD_PX)


def _rim(frame_bgr: Image, place: AppearanceMatch, one: Expected) -> Floats | None:
    """The centre of the rim about a place [px], (2,); None where there is none."""
    assert one.outline is not None
    reach = int(2.0 * (one.outline.area_px / np.pi) ** 0.5 + 8.0)
    u, v = (round(float(x)) for x in place.center_px)
    corner = np.array([max(u - reach, 0), max(v - reach, 0)])
    patch = np.ascontiguousarray(frame_bgr[corner[1] : v + reach + 1, corner[0] : u + reach + 1])
    if min(patch.shape[:2]) < reach:
        return None
    rim = fit_rim(patch, np.array([[*(place.center_px - corner), 1.0]]), one.outline)
    return None if rim is None else np.asarray(rim.center_px + corner, dtype=np.float64)
