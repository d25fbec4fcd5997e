"""Detections from matches of an appearance model: tests of a match, and the covariance of its centre."""

from __future__ import annotations

from dataclasses import replace
from math import exp

import numpy as np

from vision.arrays import Floats, Image
from vision.detection.expected import Expected
from vision.detection.records import Detection
from vision.detection.rim import fit_rim
from vision.detection.settings import DetectionSettings
from vision.tracking.appearance import AppearanceMatch
from vision.tracking.settings import FINDER, CandidateSettings, FinderSettings


def is_mark(match: AppearanceMatch, color_distance: float, settings: CandidateSettings = FINDER.candidates) -> bool:
    """Whether a match of a mark's appearance model shows the mark.

    color_distance: distance of the match's colour, as in `AdaptiveHue.distance`. If it exceeds 1, the match needs a
        higher score.
    """
    share = settings.free_share if is_free(match, settings) else settings.share
    return match.score >= _least_score(settings.score, color_distance) and match.share >= share


def is_mark_in_other_light(
    match: AppearanceMatch, color_distance: float, settings: CandidateSettings = FINDER.candidates
) -> bool:
    """Whether a match with a fitted colour shows the mark. The limits are stricter than in `is_mark`.

    color_distance: distance of the fitted colour, as in `AdaptiveHue.distance`
    """
    least = _least_score(settings.score + settings.other_margin, color_distance)
    if is_free(match, settings):
        return match.score >= least and match.share >= settings.free_share
    return match.share >= settings.share and match.around <= -settings.other_margin and match.weighed >= least


def _least_score(score: float, color_distance: float) -> float:
    """Least score that a match needs [1]: `score * max(color_distance, 1) ** 2`."""
    return score * max(color_distance, 1.0) ** 2


def is_free(match: AppearanceMatch, settings: CandidateSettings = FINDER.candidates) -> bool:
    """Whether the ring of pixels around a match shows background, because its colours are unlike the mark's colour."""
    return match.around < settings.free


def detection_at(match: AppearanceMatch, one: Expected, settings: CandidateSettings = FINDER.candidates) -> Detection:
    """Detection of a mark at the centre of a match. The lower the score, the larger is the covariance [px²]."""
    assert one.outline is not None
    area, cov_px2 = match.share * one.outline.area_px, _sd_px(match, settings) ** 2 * np.eye(2)
    return Detection(match.center_px, cov_px2, area, one.hue_deg, False, True, match.color_bgr)


def detection_in_other_light(
    frame_bgr: Image, match: AppearanceMatch, one: Expected, settings: FinderSettings = FINDER
) -> Detection:
    """Detection of a mark at a match. The mark's colour was fitted to the picture, because the light may have changed.

    If a rim is near the match, the detection's centre is the mean of the match's centre and the rim's centre.
    frame_bgr: (height, width, 3) uint8
    """
    seen, limits = detection_at(match, one, settings.candidates), settings.candidates
    rim_px = _rim_px(frame_bgr, match, one, settings.detection)
    away = np.inf if rim_px is None else float(np.hypot(*(rim_px - match.center_px)))
    if rim_px is None or away > settings.templates.near_px:
        return seen
    cov_px2 = seen.cov_px2 + (limits.rim_gain * away) ** 2 * np.eye(2)
    return replace(seen, center_px=(match.center_px + rim_px) / 2.0, cov_px2=cov_px2)


def _rim_px(frame_bgr: Image, match: AppearanceMatch, one: Expected, settings: DetectionSettings) -> Floats | None:
    """The centre of the rim around a match [px], (2,); None if no rim is found."""
    assert one.outline is not None
    reach = int(2.0 * (one.outline.area_px / np.pi) ** 0.5 + settings.coverage.pad_px)
    u, v = (round(float(x)) for x in match.center_px)
    corner = np.array([max(u - reach, 0), max(v - reach, 0)])
    patch = np.ascontiguousarray(frame_bgr[corner[1] : v + reach + 1, corner[0] : u + reach + 1])
    if min(patch.shape[:2]) < reach:
        return None
    rim = fit_rim(patch, np.array([[*(match.center_px - corner), 1.0]]), one.outline, settings)
    return None if rim is None else np.asarray(rim.center_px + corner, dtype=np.float64)


def fused(seen: Detection, match: AppearanceMatch, settings: CandidateSettings = FINDER.candidates) -> Detection:
    """Combine a detection with a match of the same mark. The new centre is the weighted mean of both centres."""
    variance = _sd_px(match, settings) ** 2
    gain = seen.cov_px2 @ np.linalg.inv(seen.cov_px2 + variance * np.eye(2))
    center_px = seen.center_px + gain @ (match.center_px - seen.center_px)
    return replace(seen, center_px=center_px, cov_px2=settings.shared * variance * gain)


def _sd_px(match: AppearanceMatch, settings: CandidateSettings) -> float:
    """Standard deviation of the centre of a match [px]."""
    below = max(settings.best_score - match.score, 0.0)
    return min(settings.min_sd_px * exp(settings.growth * below), settings.max_sd_px)
