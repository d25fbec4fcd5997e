"""One camera in space: the marks that it may see, the search for them in its pictures, and its pose.

Reference marks, which are fixed in the world, correct the pose of each camera before marks are triangulated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import vision
from estimators import MarkMeasurement, PoseEstimate, PoseFilter
from experiments.arrays import Floats
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.reference import reference_places
from experiments.formats.scene.scene import Scene
from experiments.formats.scene.space_marks import TOWARD, across, facing, mark_shapes_px
from experiments.pipeline.sight.plane import SIZE_SD, ReferenceSeen, pose_settings
from vision import LostMark, Pose, Reason, SpaceCamera
from vision.arrays import Image
from vision.tracking.association import AssociatedMark
from vision.tracking.settings import STAGE_NAMES, FinderSettings

LEAST_COSINE = 0.3
"""Cosine [1] of the largest angle between a mark's normal and the direction to the camera; choice: 73 degrees, because
the detector rejects shapes whose width is below a quarter of their length."""

PATIENCE, AGAIN = 3, 6
"""Numbers of frames [1]; choice. After PATIENCE frames without a mark, a camera searches for this mark only in every
AGAIN-th frame, because each search for a hidden mark covers the whole picture and is slow."""

STAGES = tuple(name for name in STAGE_NAMES if name != "other light")
"""Search stages of the finders. The slowest stage, "other light", is omitted: other cameras may see the mark."""


class CameraSight:
    """Finder of marks in the pictures of one camera.

    normals: outward unit normals of the marks, (n, 3); steps: `steps` of `vision.Seen`, the errors of the camera
    lost: by node, the reason why its mark was not found
    """

    def __init__(
        self, camera: SpaceCamera, marks: Sequence[Mark], normals: Floats, steps: Floats, *, explain: bool = False
    ) -> None:
        self.camera, self.steps = camera, steps
        self._marks = {mark.node: mark for mark in marks}
        self._numbers = {node: i for i, node in enumerate(self._marks)}
        self._normals, self._discs = normals, across(normals)
        settings = FinderSettings(stages=STAGES)
        self.finder = vision.MarkFinder([mark.hue for mark in marks], settings, explain=explain)
        self.lost: dict[str, LostMark] = {}
        self._unseen = dict.fromkeys(self._marks, 0)
        self._n_frames = 0

    def find(
        self,
        image: Image,
        expected: Sequence[vision.Expected],
        after_impulse: Callable[[str], vision.Expected],
    ) -> list[AssociatedMark]:
        """The expected marks found in a picture, (height, width, 3) BGR.

        A mark that was not found in `PATIENCE` consecutive frames is searched for only in every `AGAIN`-th frame.
        after_impulse: function from a node to the expected image of its mark after an impulse on the node
        """
        again = self._n_frames % AGAIN == 0
        searched = [one for one in expected if again or self._unseen[one.name] < PATIENCE]
        if self.finder.missed is not None:
            self.finder.missed &= {one.name for one in searched}
        found = self.finder.find(image, searched, after_impulse)
        names = {one.name for one in found}
        for one in searched:
            self._unseen[one.name] = 0 if one.name in names else self._unseen[one.name] + 1
            self.lost.pop(one.name, None)
        self.lost |= {one.name: one for one in self.finder.lost}
        self._n_frames += 1
        return found

    def expected(self, means: Floats, covs: Floats) -> tuple[list[vision.Expected], dict[str, LostMark]]:
        """Expected images of the marks that the camera may see, and the reasons why it cannot see the remaining marks.

        means, covs: expected positions [m], (n, 3), and covariances [m²], (n, 3, 3)
        """
        inside, places, J = self.camera.viewed(means)
        visible = inside & facing(self.camera, means, self._normals, LEAST_COSINE)
        away = {
            node: LostMark(node, Reason.AWAY if inside[i] else Reason.OUTSIDE)
            for node, i in self._numbers.items()
            if not visible[i]
        }
        rows = np.flatnonzero(visible)
        return self._looked_for(rows, means[rows], covs[rows], places[rows], J[rows]), away

    def one(self, node: str, mean: Floats, cov: Floats) -> vision.Expected:
        """Expected image of a mark at this position [m], (3,), with this covariance [m²], (3, 3)."""
        rows, means = np.array([self._numbers[node]]), mean[None]
        return self._looked_for(rows, means, cov[None], *self.camera.seen(means))[0]

    def _looked_for(
        self, rows: NDArray[np.int64], means: Floats, covs: Floats, places_px: Floats, by_place: Floats
    ) -> list[vision.Expected]:
        if not len(rows):
            return []
        covs_px2 = by_place @ covs @ by_place.transpose(0, 2, 1)
        if len(self.steps):
            by = self.camera.moved_by(means, self.steps)
            covs_px2 = covs_px2 + by @ by.transpose(0, 2, 1)
        marks = [list(self._marks.values())[i] for i in rows.tolist()]
        shapes = mark_shapes_px(marks, self.camera, means, self._discs[rows], by_place)
        return [
            vision.Expected(
                mark.node, places_px[k], covs_px2[k], mark.hue_deg, vision.Outline(shapes[k], SIZE_SD, mark.even)
            )
            for k, mark in enumerate(marks)
        ]


class CameraPose:
    """Estimator of the pose of a camera in space from its reference marks."""

    def __init__(self, scene: Scene, number: int) -> None:
        self._calibrated, self._calibration = scene.space_cameras[number], scene.calibration_steps[number]
        self._n, n_own = scene.n_calibration, scene.n_pose
        self._own = slice(len(self._calibration) + n_own * number, len(self._calibration) + n_own * (number + 1))
        marks, places = scene.reference.looks, reference_places(scene.reference, scene.network)
        self._places = {mark.node: places[mark.node] for mark in marks}
        depth_m = np.linalg.norm(np.mean(list(places.values()), axis=0) - self._calibrated.centre_m)
        self._m_per_px = float(depth_m / self._calibrated.lens.matrix[[0, 1], [0, 1]].mean())
        self._place_cov = scene.reference.position_sd_m**2 * np.eye(3)
        self._filter = PoseFilter(
            places,
            pose_settings(scene.reference),
            n_calibration=len(self._calibration),
            place_sd_m=scene.reference.position_sd_m,
            seen=self._scaled,
        )
        self.sight = CameraSight(self._calibrated, marks, np.tile(TOWARD, (len(marks), 1)), self._calibration)
        self._set(self._filter.estimate)

    def update(self, image: Image, exposure_s: float) -> ReferenceSeen:
        """Update with a picture, (height, width, 3) BGR, and find the reference marks in it."""
        self._filter.predict(exposure_s)
        self._set(self._filter.estimate)
        camera, places = self.sight.camera, np.array(list(self._places.values()))
        by = dict(zip(self._places, self._m_per_px * camera.moved_by(places, self._calibration), strict=True))
        own_px2 = camera.calibration_sd_px**2 * np.eye(2)
        expected, _ = self.sight.expected(places, np.tile(self._place_cov, (len(places), 1, 1)))
        marks = [
            MarkMeasurement(
                one.name,
                self._m_per_px * one.detection.center_px,
                self._m_per_px**2 * (one.detection.cov_px2 + own_px2),
                by[one.name],
            )
            for one in self.sight.find(image, expected, self._after_move)
        ]
        moved = self._filter.update(marks)
        self._set(self._filter.estimate)
        moves = {} if moved is None else {camera.name: moved}
        return ReferenceSeen(tuple(mark.node for mark in marks), self._filter.wrong, moves)

    def _after_move(self, name: str) -> vision.Expected:
        self._set(self._filter.after_move)
        return self.sight.one(name, self._places[name], self._place_cov)

    def _scaled(self, points_m: Floats) -> tuple[Floats, Floats]:
        """Projections of points [m], (n, 3), into the calibrated camera, times metres per pixel; and derivatives."""
        _, places_px, J = self._calibrated.viewed(points_m)
        return self._m_per_px * places_px, self._m_per_px * J

    def _set(self, pose: PoseEstimate) -> None:
        """Set the finder's camera to this pose, with the errors of this pose and of the camera's calibration."""
        motion, n = pose.motion, len(self._calibration)
        own = self._calibrated.pose
        moved = own.after(Pose(motion.rotation, motion.moved(np.zeros((1, 3)))[0]))
        changes = np.zeros((self._n, len(pose.cov)))
        changes[:n], changes[self._own] = pose.columns.T, np.linalg.cholesky(pose.cov).T
        turns = changes[:, 3:] @ own.rotation.T
        # the motion rotates about its own centre, the camera's pose rotates about the camera's centre
        shifts = changes[:, :3] @ own.rotation.T - np.cross(turns, moved.rotation @ motion.centre)
        steps = np.concatenate([np.zeros((self._n, 9)), turns, shifts], axis=1)
        steps[:n] += self._calibration
        self.sight.camera, self.sight.steps = replace(self._calibrated, pose=moved), steps
