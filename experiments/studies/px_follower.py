"""Track marks in the picture alone: Kalman filters of constant velocity predict where each is next."""

from __future__ import annotations

from collections.abc import Mapping

import filterpy.kalman as filterpy
import numpy as np
from filterpy.common import Q_continuous_white_noise

from experiments.arrays import Floats
from vision import Detection, Expected, Frame, MarkFinder, MarkHue, Outline

GONE = 10
"""Frames unseen after which a mark is searched anywhere; chosen."""
FASTEST_PX_S = 1500.0
"""Standard deviation of a velocity at the first sight [px/s]; chosen."""


class PxFollower:
    """Where marks are in the picture, frame after frame, whatever they sit on.

    hues: of each mark, by its name
    jolt_px: white acceleration of a mark in the picture [px/s²/sqrt(Hz)]
    starts_px: where marks are in the first frame, each (2,), give or take start_sd_px; anywhere where there is none
    State: a filter for each mark that is in view; how many frames each was unseen; the time.
    """

    def __init__(
        self,
        hues: Mapping[str, MarkHue],
        jolt_px: float,
        starts_px: Mapping[str, Floats] | None = None,
        start_sd_px: float = 5.0,
    ) -> None:
        self.finder = MarkFinder(hues.values())
        self._hues, self._jolt_px = hues, jolt_px
        self._unseen = dict.fromkeys(hues, 0)
        self._time_s: float | None = None
        cov = start_sd_px**2 * np.eye(2)
        self.filters = {name: _started(place, cov) for name, place in (starts_px or {}).items()}

    def see(self, frame: Frame, outlines: Mapping[str, Outline]) -> dict[str, Detection]:
        """The marks seen in the next frame, by name; outlines: of each."""
        dt = 0.0 if self._time_s is None else frame.exposure_s - self._time_s
        self._time_s = frame.exposure_s
        if dt > 0.0:
            F = np.kron(np.array([[1.0, dt], [0.0, 1.0]]), np.eye(2))
            Q = np.kron(Q_continuous_white_noise(2, dt, spectral_density=self._jolt_px**2), np.eye(2))
            for each in self.filters.values():
                each.predict(F=F, Q=Q)
        height, width = frame.image.shape[:2]
        anywhere = np.array([width / 2.0, height / 2.0]), np.diag([width**2, height**2]) / 4.0
        expected = []
        for name, hue in self._hues.items():
            known = self.filters.get(name)
            mean, cov = anywhere if known is None else (known.x[:2], known.P[:2, :2])
            expected.append(Expected(name, mean, cov, hue.hue_deg, outlines[name]))
        found = {one.name: one.detection for one in self.finder.find(frame.image, expected)}
        for name in self._hues:
            self._take(name, found.get(name))
        return found

    def _take(self, name: str, seen: Detection | None) -> None:
        self._unseen[name] = 0 if seen is not None else self._unseen[name] + 1
        if seen is None:
            if self._unseen[name] > GONE:
                self.filters.pop(name, None)
        elif name in self.filters:
            self.filters[name].update(seen.center_px, R=seen.cov_px2, H=np.eye(2, 4))
        else:
            self.filters[name] = _started(seen.center_px, seen.cov_px2)


def _started(place_px: Floats, cov_px2: Floats) -> filterpy.KalmanFilter:
    started = filterpy.KalmanFilter(4, 2)
    started.x = np.array([*place_px, 0.0, 0.0])
    started.P = np.zeros((4, 4))
    started.P[:2, :2], started.P[2:, 2:] = cov_px2, FASTEST_PX_S**2 * np.eye(2)
    return started
