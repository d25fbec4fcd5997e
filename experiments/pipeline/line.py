"""Processing of one frame: predict, find and identify the marks, update the filter and the paper's open loop."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

import vision
from estimators import (
    AssociationFilter,
    FilterSettings,
    FixBias,
    Guidance,
    IdentitySwap,
    LeaveOneOut,
    MarkMeasurement,
    OpenLoop,
    TargetEstimate,
    TissueFilter,
)
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.recording import Fix
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.scene import Scene
from experiments.pipeline.sight.plane import ReferenceMarks, ReferenceSeen, looked_for, on_plane
from experiments.pipeline.sight.space import SpaceSight
from vision import PlaneCamera

OPEN_LOOP, FILTER = "open-loop", "filter"

MOST_STATES = 600
"""Largest size of the filter's state that commands accept; choice: positions and velocities of 100 free nodes in space.
With a larger state the filter's preparation takes minutes; the filter itself has no limit."""

USUAL_BIAS = FixBias(sd_m=1e-3)
"""Default error that all direct measurements of the target (fixes) share: calibration error of an ultrasound probe."""


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """Record of the search for marks in a frame.

    expected: predicted position of each node's mark [m], (dim,), and its covariance [m²], (dim, dim)
    lost: reason why a mark was not found, by the mark's node; for another tracker's marks the reason is None
    came: new distractors, which are objects with the colour of a mark
    """

    expected: Mapping[str, tuple[Floats, Floats]]
    lost: Mapping[str, vision.LostMark | None]
    came: tuple[vision.Distractor, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """Result of one frame.

    estimates: the target's estimate by each method
    marks: all identified marks, also those that the filter does not use; corrected if the scene has reference marks
    swap: a detected exchange of names between marks; None in almost all frames
    refused: nodes whose marks the gate rejected
    sight: record of the search for marks; None if `Line` has explain=False
    reference: result for the reference marks; None if the scene has none
    detect_s: computing time to find the marks [s]; method_s: computing time of each method, predictions included [s]
    predict_s: computing time of the filter's prediction [s]
    """

    estimates: dict[str, TargetEstimate]
    marks: tuple[MarkMeasurement, ...]
    detect_s: float
    method_s: dict[str, float]
    swap: IdentitySwap | None = None
    refused: tuple[str, ...] = ()
    sight: Sight | None = None
    predict_s: float = 0.0
    reference: ReferenceSeen | None = None

    @property
    def stages_s(self) -> dict[str, float]:
        """Computing time of each stage of a frame [s]: predict, detect, update."""
        return {
            "predict": self.predict_s,
            "detect": self.detect_s,
            "update": self.method_s[FILTER] - self.predict_s,
        }


Found = tuple[Sequence[MarkMeasurement], ReferenceSeen | None, Sight | None]
"""The identified marks of a frame, the result for the reference marks, and the record of the search for marks."""

AnyFrame = vision.Frame | vision.Exposure | None
"""A frame of one camera, pictures of several cameras in space, or None for another tracker's marks."""


class Watcher(Protocol):
    """Protocol of an observer of each frame and its step."""

    def take(self, frame: AnyFrame, line: Line, step: Step, guidance: Guidance | None = None) -> None:
        """Called after each step; line: the pipeline after the step; guidance: the advice, or None if there is none."""


class Film(Watcher, Protocol):
    """Protocol of a watcher that writes a film of the run."""

    def finish(self, folder: Path) -> None:
        """End the film after the last frame, and move it to `folder`."""


class Line:
    """Processes the frames of one scene in order of exposure.

    baseline: whether the paper's open loop also runs, in which marks drive the model without a filter
    fixes: direct measurements of the target; the filter uses each at its time, and also estimates their common error
    check: whether each mark is also predicted by a filter that does not use it; bad predictions increase the covariance
    explain: whether each step records the search for marks, with the reasons why some were not found
    """

    def __init__(
        self,
        scene: Scene,
        *,
        baseline: bool = True,
        fixes: Sequence[Fix] = (),
        check: bool = False,
        explain: bool = False,
    ) -> None:
        self.scene = scene
        measured = scene.measured_nodes
        settings = with_bias_of_fixes(scene.settings, fixes)
        self._fixes = deque(sorted(fixes, key=lambda fix: fix.time_s))
        common = scene.network, scene.target.point, measured, settings
        made = LeaveOneOut if check else TissueFilter
        filters = made(*common, uncertainty=scene.uncertainty, n_calibration=scene.n_calibration)
        self.checks = filters if isinstance(filters, LeaveOneOut) else None
        self.filter = filters.tissue if isinstance(filters, LeaveOneOut) else filters
        self.identity = AssociationFilter(self.filter, scene.nodes_alike)
        self.open_loop = OpenLoop(scene.network, scene.target.point) if baseline else None
        self.reference = ReferenceMarks(scene) if scene.reference.marks else None
        self._measured = frozenset(measured)
        self._explain = explain
        self._marks: dict[str, Mark] = {}
        self.space: SpaceSight | None = None
        self.colour(scene.marks)

    def colour(self, marks: tuple[Mark, ...]) -> None:
        """Search for marks in the colours that `marks` state; the appearance learnt so far is discarded."""
        self.scene = replace(self.scene, marks=marks)
        self._marks = {mark.node: mark for mark in marks}
        self.finder = vision.MarkFinder([mark.hue for mark in marks], explain=self._explain)
        if self.scene.space_cameras:
            poses = None if self.space is None else self.space.poses
            self.space = SpaceSight(self.scene, explain=self._explain, poses=poses)

    @property
    def camera(self) -> PlaneCamera:
        """The scene's first camera; if there are reference marks, they correct its pose."""
        camera = self.scene.cameras[0]
        return camera if self.reference is None else self.reference.camera(camera)

    def see(self, exposure_s: float, image: NDArray[np.uint8]) -> Step:
        """Process a picture, (height, width, 3) BGR, with this exposure time [s]."""
        return self._step(exposure_s, lambda: self._found_on_plane(image))

    def see_all(self, exposure: vision.Exposure) -> Step:
        """Process the pictures that cameras in space took at one time."""
        return self._step(exposure.exposure_s, lambda: self._found_in_space(exposure))

    def take(self, exposure_s: float, marks: Sequence[MarkMeasurement]) -> Step:
        """Process another tracker's marks with this exposure time [s]."""
        return self._step(exposure_s, lambda: self._found_by_tracker(marks))

    def _step(self, exposure_s: float, find: Callable[[], Found]) -> Step:
        """Predict the filter, find the marks, and update all methods."""
        began = time.perf_counter()
        self._predict(exposure_s)
        predicted = time.perf_counter()
        marks, reference, sight = find()
        found = time.perf_counter()
        measured = [mark for mark in marks if mark.node in self._measured]
        refused_before = self.filter.rejected.copy()
        named = self.identity.update(measured)
        estimate = named.estimate if self.checks is None else self.checks.checked(named.estimate, named.marks)
        estimates = {FILTER: estimate}
        filtered = time.perf_counter()
        method_s = {FILTER: predicted - began + filtered - found}
        if self.open_loop is not None:
            estimates[OPEN_LOOP] = self.open_loop.update(exposure_s, named.marks)
            method_s[OPEN_LOOP] = time.perf_counter() - filtered
        unmeasured = [mark for mark in marks if mark.node not in self._measured]
        refused = _refused(named.estimate, named.marks, self.filter.rejected - refused_before)
        seen, detect_s, predict_s = (*named.marks, *unmeasured), found - predicted, predicted - began
        return Step(estimates, seen, detect_s, method_s, named.swap, refused, sight, predict_s, reference)

    def _found_by_tracker(self, marks: Sequence[MarkMeasurement]) -> Found:
        """The marks on the tissue that another tracker measured, corrected by its reference marks."""
        by, seen = self.reference, None
        if by is not None:
            seen = by.update([mark for mark in marks if by.is_one(mark.node)])
            marks = [by.pose.corrected(mark) for mark in marks if not by.is_one(mark.node)]
        named = self.identity.named(marks)
        return named, seen, self._sight(dict.fromkeys(self._measured - {mark.node for mark in named}))

    def _sight(
        self, lost: Mapping[str, vision.LostMark | None], came: tuple[vision.Distractor, ...] = ()
    ) -> Sight | None:
        """Record of the search for marks; None if `explain` is false."""
        if not self._explain:
            return None
        return Sight({node: self._prediction(node, self.filter.expected) for node in self._marks}, lost, came)

    def _predict(self, exposure_s: float) -> None:
        """Predict the filter to this exposure time [s], and use all earlier direct measurements of the target."""
        if self.checks is not None:
            for other in self.checks.without.values():
                other.predict(exposure_s)
        while self._fixes and self._fixes[0].time_s <= exposure_s:
            fix = self._fixes.popleft()
            if self.filter.time_s is None or fix.time_s >= self.filter.time_s:
                self.filter.predict(fix.time_s)
                self.identity.fix(fix.position_m, fix.cov)
        self.filter.predict(exposure_s)
        if self.reference is not None:
            self.reference.predict(exposure_s)

    def _found_on_plane(self, image: NDArray[np.uint8]) -> Found:
        """The marks in a picture of one camera, on the plane."""
        by = self.reference
        reference = None if by is None else by.update(by.find(image))
        camera = self.camera
        expected = [self._looked_for(camera, node, self.filter.expected) for node in self._marks]
        found = self.finder.find(
            image, expected, lambda node: self._looked_for(camera, node, self.filter.expected_after_impulse)
        )
        marks = on_plane(self.scene.cameras[0], self._marks, found)
        corrected = marks if by is None else tuple(by.pose.corrected(mark) for mark in marks)
        return corrected, reference, self._sight({one.name: one for one in self.finder.lost}, self.finder.came)

    def _found_in_space(self, exposure: vision.Exposure) -> Found:
        """The marks in the pictures of cameras in space."""
        assert self.space is not None
        marks = self.space.find(exposure, self.filter.expected_of, self.filter.expected_after_impulse)
        sight = Sight(self.space.expected, self.space.lost, self.space.came) if self._explain else None
        return marks, self.space.reference, sight

    def _looked_for(
        self, camera: PlaneCamera, node: str, predict: Callable[..., tuple[Floats, Floats]]
    ) -> vision.Expected:
        return looked_for(camera, self._marks[node], *self._prediction(node, predict))

    def _prediction(self, node: str, predict: Callable[..., tuple[Floats, Floats]]) -> tuple[Floats, Floats]:
        """Predicted position of a node's mark [m] and its covariance [m²], including the camera's errors."""
        mean, cov = predict(node)
        if not self.scene.n_calibration:
            return mean, cov
        if self.reference is not None:
            return predict(node, self.reference.shared_at(mean))
        if self.space is not None:
            return mean, cov
        return predict(node, self.scene.cameras[0].calibration_error(mean[None])[0])

    def used(self, step: Step) -> list[MarkMeasurement]:
        """The marks of a step that the filter used."""
        return [mark for mark in step.marks if mark.node in self._measured and mark.node not in step.refused]


def check_followed(scene: Scene, place: object = "scene") -> None:
    """Raise InputError if the network has so many free nodes that the filter's preparation would take minutes."""
    network = scene.network
    if network.n_state > MOST_STATES:
        most, where = MOST_STATES // (2 * network.dim), "in the plane" if network.dim == 2 else "in space"
        found = str(len(network.free))
        raise InputError.at(f"{place}: network.node", f"at most {most} free nodes for a filter {where}", found)


def _refused(estimate: TargetEstimate, marks: Sequence[MarkMeasurement], counted: Mapping[str, int]) -> tuple[str, ...]:
    """Nodes of the marks that the gate rejected; counted: number of rejections in this frame, by node."""
    taken = estimate.information_share
    return tuple(mark.node for mark in marks if (mark.node not in taken if taken else mark.node in counted))


def with_bias_of_fixes(settings: FilterSettings, fixes: Sequence[Fix]) -> FilterSettings:
    """The filter's settings for these fixes: `USUAL_BIAS` is their shared error if `settings` states none."""
    return replace(settings, fix_bias=USUAL_BIAS) if fixes and settings.fix_bias is None else settings
