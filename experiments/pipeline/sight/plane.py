"""Marks on the plane: positions of marks found in a picture, and the camera's pose, estimated from reference marks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import vision
from estimators import CameraMove, MarkMeasurement, PoseEstimate, PoseFilter, PoseSettings
from experiments.arrays import Floats
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.reference import Reference, reference_places
from experiments.formats.scene.scene import Scene
from vision import PlaneCamera
from vision.tracking.association import AssociatedMark

SIZE_SD = 0.05
"""Relative error of a mark's size in pictures due to print, tilt and blooming; choice."""


def looked_for(camera: PlaneCamera, mark: Mark, mean: Floats, cov: Floats) -> vision.Expected:
    """Expected image of a mark; mean, cov: its position on the plane [m], (2,), and the covariance [m²], (2, 2)."""
    center_px, cov_px2 = camera.project(mean[None])[0], camera.cov_to_px(mean[None], cov[None])[0]
    outline = vision.Outline(mark.shape_px(camera, mean), SIZE_SD, mark.even)
    return vision.Expected(mark.node, center_px, cov_px2, mark.hue_deg, outline)


def on_plane(
    camera: PlaneCamera, by_name: Mapping[str, Mark], found: Sequence[AssociatedMark]
) -> tuple[MarkMeasurement, ...]:
    """Measure the positions on the plane of marks that were found in a picture; by_name: the scene's marks by name."""
    if not found:
        return ()
    marks = [by_name[f.name] for f in found]
    centers_px = np.array([f.detection.center_px for f in found])
    covs_px = np.array([f.detection.cov_px2 for f in found]) + camera.calibration_sd_px**2 * np.eye(2)
    # perspective shifts the centre of a disc's outline; for a ball no shift is modelled
    radii_m = np.array([0.0 if mark.ball else mark.diameter_m / 2.0 for mark in marks])
    centers_px = centers_px - camera.disc_shift(camera.to_plane(centers_px), radii_m)
    positions, covs_m = camera.to_plane(centers_px), camera.cov_to_plane(centers_px, covs_px)
    shared = camera.calibration_error(positions) if camera.n_calibration else [None] * len(marks)
    return tuple(MarkMeasurement(m.node, positions[k], covs_m[k], shared[k]) for k, m in enumerate(marks))


@dataclass(frozen=True, slots=True)
class ReferenceSeen:
    """The reference marks in one frame.

    seen: names of the visible reference marks; wrong: names of reference marks that contradict the others
    moves: moves detected in this frame, by the name of the moved camera; the camera of a flat scene has the name ""
    """

    seen: tuple[str, ...]
    wrong: frozenset[str]
    moves: Mapping[str, CameraMove]

    @classmethod
    def of(cls, cameras: Sequence[ReferenceSeen]) -> ReferenceSeen:
        """Combine the results of several cameras."""
        seen = dict.fromkeys(name for one in cameras for name in one.seen)
        wrong = frozenset(name for one in cameras for name in one.wrong)
        return cls(tuple(seen), wrong, {name: move for one in cameras for name, move in one.moves.items()})


def pose_settings(stated: Reference) -> PoseSettings:
    """Settings of the pose filter for a scene's reference marks."""
    usual = PoseSettings()
    return usual if stated.drift_sd_m is None else replace(usual, start_m=max(stated.drift_sd_m, LEAST_M))


class ReferenceMarks:
    """Estimator of the pose of a scene's camera or tracker from its reference marks."""

    def __init__(self, scene: Scene) -> None:
        stated = scene.reference
        self._calibrated = scene.cameras[0] if scene.cameras else None
        self._places = reference_places(stated, scene.network)
        self._looks = {mark.node: mark for mark in stated.looks}
        self._place_cov = stated.position_sd_m**2 * np.eye(scene.network.dim)
        self.filter = PoseFilter(
            self._places,
            pose_settings(stated),
            n_calibration=scene.n_calibration - scene.n_pose,
            place_sd_m=stated.position_sd_m,
        )
        self.pose: PoseEstimate = self.filter.estimate
        self._finder = vision.MarkFinder([mark.hue for mark in stated.looks])

    def predict(self, exposure_s: float) -> None:
        """Predict the pose at this exposure time [s]."""
        self.filter.predict(exposure_s)
        self.pose = self.filter.estimate

    def find(self, image: NDArray[np.uint8]) -> tuple[MarkMeasurement, ...]:
        """The reference marks in a picture, (height, width, 3) BGR, measured as if the camera had not moved."""
        assert self._calibrated is not None
        expected = [self._looked_for(name, self.pose) for name in self._looks]
        found = self._finder.find(image, expected, lambda name: self._looked_for(name, self.filter.after_move))
        return on_plane(self._calibrated, self._looks, found)

    def update(self, marks: Sequence[MarkMeasurement]) -> ReferenceSeen:
        """Update with the visible reference marks."""
        moved = self.filter.update(marks)
        self.pose = self.filter.estimate
        return ReferenceSeen(
            tuple(mark.node for mark in marks), self.filter.wrong, {} if moved is None else {"": moved}
        )

    def is_one(self, name: str) -> bool:
        """Whether a mark of this name is a reference mark."""
        return name in self._places

    def camera(self, calibrated: PlaneCamera) -> PlaneCamera:
        """The camera with its present pose; calibrated: the camera with its calibrated pose."""
        motion = self.pose.motion
        return calibrated.moved(motion.rotation, motion.moved(np.zeros((1, len(motion.centre))))[0])

    def shared_at(self, place: Floats) -> Floats:
        """Shifts [m], (dim, k), of the corrected mark at `place` [m], (dim,), by one sd of each shared error."""
        motion = self.pose.motion
        seen = motion.moved(place[None])[0]
        return motion.rotation.T @ self.pose.seen_shared(seen, self._calibration_error(seen))

    def _looked_for(self, name: str, pose: PoseEstimate) -> vision.Expected:
        assert self._calibrated is not None
        place = self._places[name]
        seen = pose.motion.moved(place[None])[0]
        shared = pose.seen_shared(seen, self._calibration_error(seen))
        return looked_for(self._calibrated, self._looks[name], seen, self._place_cov + shared @ shared.T)

    def _calibration_error(self, place: Floats) -> Floats | None:
        camera = self._calibrated
        return None if camera is None else camera.calibration_error(place[None])[0]


LEAST_M = 1e-6
"""Least standard deviation of the initial pose [m]; numerical."""
