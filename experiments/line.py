"""The line from a frame to the target: detect, identify, predict, update; the paper's method on the same marks."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import vision
from estimators import FixBias, LeaveOneOut, MarkMeasurement, OpenLoop, TargetEstimate, TissueFilter
from experiments.recording import Fix
from experiments.scene import Mark, Scene

Floats = NDArray[np.float64]

OPEN_LOOP, FILTER = "open-loop", "filter"

HALF_AT_LEAST = 0.5
"""Of its area a mark must show this part at least, or it is not taken for one; chosen."""


USUAL_BIAS = FixBias(sd_m=1e-3)
"""What fixes are off by together where the scene does not say: an ultrasound probe's calibration; chosen."""

BLOW_GATE = 9.21
"""Squared Mahalanobis distance at which a mark looked for after a blow is given up: chi-square, 99 %; chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What one frame gave.

    estimates: by method
    marks: all marks identified in the frame, those for scoring only included
    detect_s, method_s: seconds spent on finding marks, and by method
    """

    estimates: dict[str, TargetEstimate]
    marks: tuple[MarkMeasurement, ...]
    detect_s: float
    method_s: dict[str, float]


class Line:
    """Runs the methods through the frames of one scene, in order of exposure.

    check: predict each mark as if it were hidden, too, and widen the covariance where that shows the model wrong
    fixes: direct sightings of the target, fused at their times; what they are off by together is estimated, too
    State: the filter, the filters that check it, the paper's open loop (baseline=False leaves it out), the marks missed
    in the last frame, the fixes still to come.
    """

    def __init__(self, scene: Scene, *, baseline: bool = True, fixes: Sequence[Fix] = (), check: bool = False) -> None:
        self.scene = scene
        measured = scene.measured_nodes
        settings = scene.settings
        if fixes and settings.fix_bias is None:
            settings = replace(settings, fix_bias=USUAL_BIAS)
        self._fixes = deque(sorted(fixes, key=lambda fix: fix.time_s))
        told = scene.network, scene.target.node, measured, settings
        self.checks = LeaveOneOut(*told, uncertainty=scene.uncertainty) if check else None
        self.filter = TissueFilter(*told, uncertainty=scene.uncertainty) if self.checks is None else self.checks.tissue
        self.open_loop = OpenLoop(scene.network, scene.target.node) if baseline else None
        self._measured = frozenset(measured)
        self._missed: set[str] = set()
        self._hues = {mark.hue_deg: vision.MarkHue(mark.hue_deg) for mark in scene.marks}
        self._min_area_px = self._smallest_area() if scene.cameras else 0.0

    def _smallest_area(self) -> float:
        camera = self.scene.cameras[0]
        areas = []
        for mark in self.scene.marks:
            position = self.scene.network.positions[self.scene.network.index(mark.node)]
            across, down = 1e3 * mark.diameter_m / camera.mm_per_px(position)
            areas.append(np.pi / 4.0 * across * down)
        return HALF_AT_LEAST * min(areas)

    def see(self, exposure_s: float, image: NDArray[np.uint8]) -> Step:
        """Estimates at this exposure time [s] from a frame, (height, width, 3) BGR."""
        began = time.perf_counter()
        detections = vision.detect_marks(image, list(self._hues.values()), min_area_px=self._min_area_px)
        detected = time.perf_counter()
        self._predict(exposure_s)
        predicted = time.perf_counter()
        marks = self._identified(detections)
        identified = time.perf_counter()
        detect_s = detected - began + identified - predicted
        return self._estimated(exposure_s, marks, detect_s, predicted - detected)

    def take(self, exposure_s: float, marks: Sequence[MarkMeasurement]) -> Step:
        """Estimates at this exposure time [s] from marks that another tracker found."""
        began = time.perf_counter()
        self._predict(exposure_s)
        return self._estimated(exposure_s, tuple(marks), 0.0, time.perf_counter() - began)

    def _predict(self, exposure_s: float) -> None:
        """Move the filter to this time [s], by way of the fixes that came until then."""
        if self.checks is not None:
            for other in self.checks.without.values():
                other.predict(exposure_s)
        while self._fixes and self._fixes[0].time_s <= exposure_s:
            fix = self._fixes.popleft()
            if self.filter.time_s is None or fix.time_s >= self.filter.time_s:
                self.filter.predict(fix.time_s)
                self.filter.fix(fix.position_m, fix.sd_m**2 * np.eye(len(fix.position_m)))
        self.filter.predict(exposure_s)

    def _identified(self, detections: Sequence[vision.Detection]) -> tuple[MarkMeasurement, ...]:
        """The marks among the detections, looked for where they are expected, and what is missing as if struck."""
        found = vision.identify(detections, [self._looked_for(mark, self.filter.expected) for mark in self.scene.marks])
        missing = [mark for mark in self.scene.marks if mark.node not in {f.name for f in found}]
        left = [d for d in detections if not any(d is f.detection for f in found)]
        # A blow is believed where nothing else could be the mark, or when a mark stays away.
        if len(left) > len(missing):
            missing = [mark for mark in missing if mark.node in self._missed]
        found += vision.identify(left, [self._looked_for(mark, self.filter.struck) for mark in missing], gate=BLOW_GATE)
        self._missed = {mark.node for mark in self.scene.marks} - {f.name for f in found}
        if not found:
            return ()
        camera = self.scene.cameras[0]
        centers_px = np.array([f.detection.center_px for f in found])
        covs_px = np.array([f.detection.cov_px2 for f in found]) + camera.calibration_sd_px**2 * np.eye(2)
        positions, covs_m = camera.to_plane(centers_px), camera.cov_to_plane(centers_px, covs_px)
        return tuple(MarkMeasurement(f.name, positions[k], covs_m[k]) for k, f in enumerate(found))

    def _looked_for(self, mark: Mark, belief: Callable[[str], tuple[Floats, Floats]]) -> vision.Expected:
        camera = self.scene.cameras[0]
        mean, cov = belief(mark.node)
        center_px, cov_px2 = camera.project(mean[None])[0], camera.cov_to_px(mean[None], cov[None])[0]
        return vision.Expected(mark.node, center_px, cov_px2, mark.hue_deg)

    def _estimated(
        self, exposure_s: float, marks: tuple[MarkMeasurement, ...], detect_s: float, predict_s: float
    ) -> Step:
        measured = [mark for mark in marks if mark.node in self._measured]
        began = time.perf_counter()
        estimates = {FILTER: (self.filter if self.checks is None else self.checks).update(measured)}
        filtered = time.perf_counter()
        method_s = {FILTER: predict_s + filtered - began}
        if self.open_loop is not None:
            estimates[OPEN_LOOP] = self.open_loop.update(exposure_s, measured)
            method_s[OPEN_LOOP] = time.perf_counter() - filtered
        return Step(estimates, marks, detect_s, method_s)
