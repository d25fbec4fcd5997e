"""The reference marks of a scene, frame by frame, and the camera and marks corrected by them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import vision
from estimators import CameraMove, MarkMeasurement, PoseEstimate, PoseFilter, PoseSettings
from experiments.arrays import Floats
from experiments.formats.scene.reference import reference_places
from experiments.formats.scene.scene import Scene
from experiments.pipeline.sight.on_plane import looked_for, on_plane
from vision import PlaneCamera


@dataclass(frozen=True, slots=True)
class ReferenceSeen:
    """What a frame gave of the reference marks.

    seen: names of those that were seen; wrong: of those, the ones that are not where the others say
    moved: what is to be reported of the pose, None in all but a few frames
    """

    seen: tuple[str, ...]
    wrong: frozenset[str]
    moved: CameraMove | None


class ReferenceMarks:
    """Estimates the pose of a scene's camera or tracker by its reference marks; of a scene that has such.

    State: the filter of the pose and its estimate; the finder of the marks in pictures.
    """

    def __init__(self, scene: Scene) -> None:
        stated, usual = scene.reference, PoseSettings()
        settings = usual if stated.drift_sd_m is None else replace(usual, start_m=max(stated.drift_sd_m, LEAST_M))
        self._calibrated = scene.cameras[0] if scene.cameras else None
        n_calibration = 0 if self._calibrated is None else self._calibrated.n_calibration
        self._places = reference_places(stated, scene.network)
        self._looks = {mark.node: mark for mark in stated.looks}
        self.filter = PoseFilter(self._places, settings, n_calibration=n_calibration)
        self.pose: PoseEstimate = self.filter.estimate
        self._finder = vision.MarkFinder([mark.hue for mark in stated.looks])

    def predict(self, exposure_s: float) -> None:
        """Move to this exposure time [s]."""
        self.filter.predict(exposure_s)
        self.pose = self.filter.estimate

    def find(self, image: NDArray[np.uint8]) -> tuple[MarkMeasurement, ...]:
        """The reference marks in a frame, (height, width, 3) BGR, where the camera as calibrated sees them."""
        assert self._calibrated is not None
        expected = [self._looked_for(name, self.pose) for name in self._looks]
        found = self._finder.find(image, expected, lambda name: self._looked_for(name, self.filter.after_move))
        return on_plane(self._calibrated, self._looks, found)

    def update(self, marks: Sequence[MarkMeasurement]) -> ReferenceSeen:
        """Take in the reference marks that were seen."""
        moved = self.filter.update(marks)
        self.pose = self.filter.estimate
        return ReferenceSeen(tuple(mark.node for mark in marks), self.filter.wrong, moved)

    def is_one(self, name: str) -> bool:
        """Whether a mark of this name is a reference mark."""
        return name in self._places

    def camera(self, calibrated: PlaneCamera) -> PlaneCamera:
        """The camera as it stands now."""
        motion = self.pose.motion
        return calibrated.moved(motion.rotation, motion.moved(np.zeros((1, len(motion.centre))))[0])

    def shared_at(self, place: Floats) -> Floats:
        """The `shared` that a corrected mark at this place [m], (dim,), has."""
        motion = self.pose.motion
        seen = motion.moved(place[None])[0]
        return motion.rotation.T @ self.pose.seen_shared(seen, self._calibration_error(seen))

    def _looked_for(self, name: str, pose: PoseEstimate) -> vision.Expected:
        assert self._calibrated is not None
        place = self._places[name]
        seen = pose.motion.moved(place[None])[0]
        shared = pose.seen_shared(seen, self._calibration_error(seen))
        return looked_for(self._calibrated, self._looks[name], seen, shared @ shared.T)

    def _calibration_error(self, place: Floats) -> Floats | None:
        camera = self._calibrated
        return None if camera is None else camera.calibration_error(place[None])[0]


LEAST_M = 1e-6
"""Of the standard deviation of the pose at the start, so that it has one [m]; numerical."""
