"""The line from a frame to the target: detect, identify, predict, update; the paper's method on the same marks."""

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
from experiments.pipeline.sight import ReferenceMarks, ReferenceSeen, looked_for, on_plane
from vision import PlaneCamera

OPEN_LOOP, FILTER = "open-loop", "filter"

MOST_STATES = 600
"""Coordinates and velocities of free nodes, 100 nodes in space, beyond which a frame takes too long, about as their
cube; the commands refuse more; chosen."""

USUAL_BIAS = FixBias(sd_m=1e-3)
"""Common error of fixes where the scene states none: an ultrasound probe's calibration; the scene's to state."""


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What marks were looked for in a frame, and why some were not found.

    expected: by node, where its mark was expected [m], (dim,), and the covariance of that [m²], (dim, dim)
    lost: by node, why its mark was not found; None where another tracker looked for it
    came: what came into the picture in the colour of marks and is none
    """

    expected: Mapping[str, tuple[Floats, Floats]]
    lost: Mapping[str, vision.LostMark | None]
    came: tuple[vision.Distractor, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What one frame gave.

    estimates: by method
    marks: all marks identified in the frame, those for scoring only included, by the present association; where the
        scene has reference marks, corrected by them
    swap: marks that were found to have been taken for each other, None in all but a few frames
    refused: nodes whose marks the gate rejected
    sight: what was looked for, None where the line does not explain
    reference: what the frame gave of the reference marks, None where the scene has none
    detect_s, method_s: seconds spent on finding marks, and by method; predict_s: of the filter's, before them
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
        """Seconds that the filter's stages took, in order."""
        return {
            "predict": self.predict_s,
            "detect": self.detect_s,
            "update": self.method_s[FILTER] - self.predict_s,
        }


class Watcher(Protocol):
    """Somebody who is shown each frame, None where another tracker found the marks, and what it gave."""

    def take(self, frame: vision.Frame | None, line: Line, step: Step, guidance: Guidance | None = None) -> None:
        """The frame and its step; the advice, where one is given. The line stands as it was after them."""


class Film(Watcher, Protocol):
    """A film of the run, which `finish` moves to the folder of its tables."""

    def finish(self, folder: Path) -> None:
        """End the film: no frame comes any more."""


class Line:
    """Runs the methods through the frames of one scene, in order of exposure.

    check: predict each mark as if it were hidden, too, and widen the covariance where that shows the model wrong
    fixes: direct sightings of the target, fused at their times; their common error is estimated, too
    explain: keep what is looked for and why it is not found, in each step; estimates are the same
    State: the filter, the names of its marks (identity), the filters that check it, the paper's open
    loop (baseline=False leaves it out), what is known of the marks' colours, the fixes still to come; of a scene with
    reference marks, the pose of the camera or tracker by them.
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
        self.colour(scene.marks)

    def colour(self, marks: tuple[Mark, ...]) -> None:
        """Look for the scene's marks in these colours from now on; what was learnt of their appearance goes."""
        self.scene = replace(self.scene, marks=marks)
        self._marks = {mark.node: mark for mark in marks}
        self.finder = vision.MarkFinder([mark.hue for mark in marks], explain=self._explain)

    @property
    def camera(self) -> PlaneCamera:
        """The scene's first camera as it stands now, by the reference marks."""
        camera = self.scene.cameras[0]
        return camera if self.reference is None else self.reference.camera(camera)

    def see(self, exposure_s: float, image: NDArray[np.uint8]) -> Step:
        """Estimates at this exposure time [s] from a frame, (height, width, 3) BGR."""
        began = time.perf_counter()
        self._predict(exposure_s)
        predicted = time.perf_counter()
        reference = None if self.reference is None else self.reference.update(self.reference.find(image))
        marks = self._found(image)
        found = time.perf_counter()
        sight = self._sight({one.name: one for one in self.finder.lost}, self.finder.came)
        step = self._estimated(exposure_s, marks, found - predicted, predicted - began, sight)
        return replace(step, reference=reference)

    def take(self, exposure_s: float, marks: Sequence[MarkMeasurement]) -> Step:
        """Estimates at this exposure time [s] from marks that another tracker found."""
        began = time.perf_counter()
        self._predict(exposure_s)
        seen, reference = self._corrected(marks)
        named = self.identity.named(seen)
        predicted = time.perf_counter()
        sight = self._sight(dict.fromkeys(self._measured - {mark.node for mark in named}))
        return replace(self._estimated(exposure_s, named, 0.0, predicted - began, sight), reference=reference)

    def _corrected(self, marks: Sequence[MarkMeasurement]) -> tuple[Sequence[MarkMeasurement], ReferenceSeen | None]:
        """The marks of the tissue, corrected by the reference marks among them, and what those gave."""
        by = self.reference
        if by is None:
            return marks, None
        seen = by.update([mark for mark in marks if by.is_one(mark.node)])
        return [by.pose.corrected(mark) for mark in marks if not by.is_one(mark.node)], seen

    def _sight(
        self, lost: Mapping[str, vision.LostMark | None], came: tuple[vision.Distractor, ...] = ()
    ) -> Sight | None:
        """What is looked for at the filter's time, where that is to be explained."""
        if not self._explain:
            return None
        return Sight({node: self._prediction(node, self.filter.expected) for node in self._marks}, lost, came)

    def _predict(self, exposure_s: float) -> None:
        """Move the filter to this time [s], by way of the fixes that came until then."""
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

    def _found(self, image: NDArray[np.uint8]) -> tuple[MarkMeasurement, ...]:
        """The marks in a frame, on the plane."""
        camera = self.camera
        expected = [self._looked_for(camera, node, self.filter.expected) for node in self._marks]
        found = self.finder.find(
            image, expected, lambda node: self._looked_for(camera, node, self.filter.expected_after_impulse)
        )
        marks = on_plane(self.scene.cameras[0], self._marks, found)
        return marks if self.reference is None else tuple(self.reference.pose.corrected(mark) for mark in marks)

    def _looked_for(
        self, camera: PlaneCamera, node: str, predict: Callable[..., tuple[Floats, Floats]]
    ) -> vision.Expected:
        return looked_for(camera, self._marks[node], *self._prediction(node, predict))

    def _prediction(self, node: str, predict: Callable[..., tuple[Floats, Floats]]) -> tuple[Floats, Floats]:
        """Where a node's mark may be [m], and the covariance of that [m²], errors of the camera in it."""
        mean, cov = predict(node)
        if not self.scene.n_calibration:
            return mean, cov
        by = self.reference
        if by is None:
            return predict(node, self.scene.cameras[0].calibration_error(mean[None])[0])
        return predict(node, by.shared_at(mean))

    def measured(self, marks: Sequence[MarkMeasurement]) -> list[MarkMeasurement]:
        """Those of the marks that the filter may use."""
        return [mark for mark in marks if mark.node in self._measured]

    def _estimated(
        self,
        exposure_s: float,
        marks: tuple[MarkMeasurement, ...],
        detect_s: float,
        predict_s: float,
        sight: Sight | None,
    ) -> Step:
        measured = self.measured(marks)
        refused_before = self.filter.rejected.copy()
        began = time.perf_counter()
        named = self.identity.update(measured)
        estimate = named.estimate if self.checks is None else self.checks.checked(named.estimate, named.marks)
        estimates = {FILTER: estimate}
        filtered = time.perf_counter()
        method_s = {FILTER: predict_s + filtered - began}
        if self.open_loop is not None:
            estimates[OPEN_LOOP] = self.open_loop.update(exposure_s, named.marks)
            method_s[OPEN_LOOP] = time.perf_counter() - filtered
        unmeasured = [mark for mark in marks if mark.node not in self._measured]
        refused = _refused(named.estimate, named.marks, self.filter.rejected - refused_before)
        return Step(estimates, (*named.marks, *unmeasured), detect_s, method_s, named.swap, refused, sight, predict_s)


def check_followed(scene: Scene, place: object = "scene") -> None:
    """Raise InputError where a filter of the scene's network would take seconds for a frame."""
    network = scene.network
    if network.n_state > MOST_STATES:
        most, where = MOST_STATES // (2 * network.dim), "in the plane" if network.dim == 2 else "in space"
        found = str(len(network.free))
        raise InputError.at(f"{place}: network.node", f"at most {most} free nodes for a filter {where}", found)


def _refused(estimate: TargetEstimate, marks: Sequence[MarkMeasurement], counted: Mapping[str, int]) -> tuple[str, ...]:
    """Nodes of the marks that the gate rejected; counted: by how much the filter's counts of them grew.

    The estimate says which marks it took, but at a start; where names were exchanged the counts are another filter's.
    """
    taken = estimate.information_share
    return tuple(mark.node for mark in marks if (mark.node not in taken if taken else mark.node in counted))


def with_bias_of_fixes(settings: FilterSettings, fixes: Sequence[Fix]) -> FilterSettings:
    """The settings with a common error of fixes, the usual one where there are fixes and none is stated."""
    return replace(settings, fix_bias=USUAL_BIAS) if fixes and settings.fix_bias is None else settings
