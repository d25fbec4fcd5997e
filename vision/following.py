"""Colours of marks as lamps, white balance and exposure drift."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vision.detect import Detection
from vision.hues import MarkHue

FOLLOW = 0.05
"""Share of the newest frame in what is believed of a colour, once so many frames were seen; chosen."""
FURTHEST = 1.5
"""How far the hue may drift from where it began, in half widths of its range; chosen."""
WEAKER = 0.6
"""Saturation and value that count, by those that marks show; chosen."""
LEAST_SATURATION, LEAST_VALUE = 0.12, 0.05
"""Below these no drift is followed: grey and black have no hue; chosen."""


class FollowedHue:
    """A kind of mark whose colour is followed from frame to frame.

    now: what counts as this kind now
    State: that, and how many frames it was learned from, and the mean colour as a vector on the circle of hues, its
    saturation and its value.
    """

    def __init__(self, hue: MarkHue) -> None:
        self.now = hue
        self._first = hue
        self._n_frames = 0
        self._color = np.zeros(4)

    def follow(self, detections: Sequence[Detection]) -> None:
        """Take in the colours of marks that were found and named; those partly covered or cut do not count."""
        colors = [d.color_bgr for d in detections if not (d.covered or d.clipped)]
        if not colors:
            return
        self._n_frames += 1
        blue, green, red = np.mean(colors, axis=0) / 255.0
        hue, saturation, value = colorsys.rgb_to_hsv(red, green, blue)
        seen = np.array([np.cos(2.0 * np.pi * hue), np.sin(2.0 * np.pi * hue), saturation, value])
        self._color += max(FOLLOW, 1.0 / self._n_frames) * (seen - self._color)
        first, furthest = self._first, FURTHEST * self._first.half_width_deg
        x, y, saturation, value = self._color.tolist()
        drift = (np.degrees(np.arctan2(y, x)) - first.middle_deg + 180.0) % 360.0 - 180.0
        self.now = replace(
            first,
            seen_deg=float((first.middle_deg + np.clip(drift, -furthest, furthest)) % 360.0),
            min_saturation=max(LEAST_SATURATION, min(first.min_saturation, WEAKER * saturation)),
            min_value=max(LEAST_VALUE, min(first.min_value, WEAKER * value)),
        )
