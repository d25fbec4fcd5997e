"""Adaptation of the colour ranges of marks to drift of lamps, white balance and exposure."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from math import exp, log

from vision.detection.hue import MarkHue, on_circle
from vision.detection.records import Detection
from vision.tracking.settings import FINDER, HueTrackingSettings

LEAST = 0.01
"""Lower bound of the adapted min_saturation and min_value, because `MarkHue` does not accept 0."""


class AdaptiveHue:
    """The colour range of a kind of mark, adapted from frame to frame.

    now: the present colour range
    """

    def __init__(self, hue: MarkHue, settings: HueTrackingSettings = FINDER.hue) -> None:
        self._settings = settings
        most = settings.max_scatter
        self._max_scatter = (most * settings.hue_sd_deg) ** 2, (most * settings.saturation_sd) ** 2
        self.now = hue
        self._first = hue
        self._n_frames = 0
        self._color, self._scatter = [0.0, 0.0, 0.0], [0.0, 0.0]
        if hue.saturation is not None and hue.value is not None:
            self._n_frames = settings.n_learned
            self._color[1:] = hue.saturation, log(hue.value)

    def distance(self, detection: Detection) -> float:
        """Squared Mahalanobis distance of a detection's colour, divided by the gate; 0 until the colour is learned."""
        if self._n_frames < self._settings.n_learned:
            return 0.0
        hue, saturation, _ = _reported(tuple(detection.color_bgr), self._first.middle_deg)
        (mean_hue, mean_saturation, _), (scatter_hue, scatter_saturation) = self._color, self._scatter
        settings = self._settings
        squared = (hue - mean_hue) ** 2 / max(scatter_hue, settings.hue_sd_deg**2)
        squared += (saturation - mean_saturation) ** 2 / max(scatter_saturation, settings.saturation_sd**2)
        return squared / settings.gate

    def follow(self, detections: Sequence[Detection]) -> None:
        """Update the colour range with the colours of found marks. Marks that are partly hidden are ignored."""
        first, settings = self._first, self._settings
        colors = [_reported(tuple(d.color_bgr), first.middle_deg) for d in detections if not (d.occluded or d.clipped)]
        if not colors:
            return
        self._n_frames += 1
        share = max(settings.gain, 1.0 / self._n_frames)
        for k, levels in enumerate(zip(*colors, strict=True)):
            away = [level - self._color[k] for level in levels]
            self._color[k] += share * sum(away) / len(away)
            if self._n_frames > 1 and k < len(self._scatter):
                spread = sum(each * each for each in away) / len(away)
                self._scatter[k] = min(self._scatter[k] + share * (spread - self._scatter[k]), self._max_scatter[k])
        furthest = settings.max_drift * first.half_width_deg
        drift, saturation, value = self._color[0], self._color[1], exp(self._color[2])
        # in steps, so that the table of classes seldom changes between frames
        drift = round(2.0 * min(max(drift, -furthest), furthest)) / 2.0
        seen_deg = on_circle(first.middle_deg + drift)
        min_saturation = max(LEAST, min(first.min_saturation, round(settings.learning.paler * saturation, 2)))
        min_value = max(LEAST, min(first.min_value, round(settings.learning.darker * value, 2)))
        if (seen_deg, min_saturation, min_value) != (self.now.seen_deg, self.now.min_saturation, self.now.min_value):
            self.now = replace(first, seen_deg=seen_deg, min_saturation=min_saturation, min_value=min_value)


@lru_cache(maxsize=64)
def _reported(color_bgr: tuple[float, ...], middle_deg: float) -> tuple[float, float, float]:
    blue, green, red = color_bgr
    hue, saturation, value = colorsys.rgb_to_hsv(max(red, 1.0) / 255.0, max(green, 1.0) / 255.0, max(blue, 1.0) / 255.0)
    return (360.0 * hue - middle_deg + 180.0) % 360.0 - 180.0, saturation, log(value)
