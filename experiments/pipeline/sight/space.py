"""Marks on a body in space, found in the pictures of several cameras and measured with all cameras that see them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

import vision
from estimators import MarkMeasurement
from experiments.arrays import Floats
from experiments.formats.scene.scene import Scene
from experiments.formats.scene.space_marks import outward
from experiments.pipeline.sight.camera import CameraPose, CameraSight
from experiments.pipeline.sight.plane import ReferenceSeen
from vision import LostMark, Reason

MISFIT = 1e-4
"""Least p-value [1] of the distances between cameras' rays to one mark. Below it, the cameras see different objects;
choice: equal to the p-value of the finder's gate in one picture."""


class SpaceSight:
    """Finds the measured marks of a scene in space in the pictures of its cameras, and measures their positions.

    A mark that several cameras see at one time is triangulated. The position of a mark that only one camera sees is on
    the camera's ray; its standard deviation along the ray is the body's size, because the depth is unknown.
    poses: estimators of the cameras' poses by name; by default they are created if the scene has reference marks
    single: nodes of the marks that only one camera saw in the newest pictures
    """

    def __init__(self, scene: Scene, *, explain: bool = False, poses: Mapping[str, CameraPose] | None = None) -> None:
        marks = [mark for mark in scene.marks if mark.measured]
        self._numbers = {mark.node: i for i, mark in enumerate(marks)}
        self._extent_m = float(np.linalg.norm(np.ptp(scene.network.positions, axis=0)))
        normals, both = (
            outward(scene, list(self._numbers)),
            zip(scene.space_cameras, scene.calibration_steps, strict=True),
        )
        self.cameras = {c.name: CameraSight(c, marks, normals, steps, explain=explain) for c, steps in both}
        if poses is None and scene.reference.marks:
            poses = {name: CameraPose(scene, i) for i, name in enumerate(self.cameras)}
        self.poses = poses or {}
        self.reference: ReferenceSeen | None = None
        self._most = chi2.isf(MISFIT, np.maximum(2 * np.arange(len(self.cameras) + 1) - 3, 1))
        self.lost: dict[str, LostMark] = {}
        self.came: tuple[vision.Distractor, ...] = ()
        self.single: frozenset[str] = frozenset()
        self.expected: dict[str, tuple[Floats, Floats]] = {}

    def find(
        self,
        exposure: vision.Exposure,
        predict: Callable[[Sequence[str]], tuple[Floats, Floats]],
        after_impulse: Callable[[str], tuple[Floats, Floats]],
    ) -> tuple[MarkMeasurement, ...]:
        """The marks in pictures taken at one time. Each picture must have the size that its camera states.

        predict: function from nodes to predicted positions [m], (n, 3), and covariances [m²], (n, 3, 3), of their marks
        after_impulse: like `predict`, for one node. The covariance also allows for an impulse on the node since the
        last frame in which the mark was found.
        """
        means, covs = predict(list(self._numbers))
        self.expected = dict(zip(self._numbers, zip(means, covs, strict=True), strict=True))
        references = []
        seen, self.lost, self.came = [], {}, ()
        for name, image in exposure.images.items():
            sight = self.cameras[name]
            if name in self.poses:
                references.append(self.poses[name].update(image, exposure.exposure_s))
                sight.camera, sight.steps = self.poses[name].sight.camera, self.poses[name].sight.steps
            expected, away = sight.expected(means, covs)
            self.lost = away | self.lost
            found = sight.find(
                image,
                expected,
                lambda node, sight=sight: sight.one(node, *after_impulse(node)),  # type: ignore[misc]
            )
            # candidates are omitted: they are positions in the picture of one camera
            self.lost |= {node: replace(one, candidate_px=None) for node, one in sight.lost.items() if node not in away}
            self.came += sight.finder.came
            if found:
                own_px2 = sight.camera.calibration_sd_px**2 * np.eye(2)
                seen.append(
                    vision.Seen(
                        sight.camera,
                        [self._numbers[one.name] for one in found],
                        np.array([one.detection.center_px for one in found]),
                        np.array([one.detection.cov_px2 for one in found]) + own_px2,
                        sight.steps,
                    )
                )
        self.reference = ReferenceSeen.of(references) if self.poses else None
        return self._measured(seen, means)

    def _measured(self, seen: Sequence[vision.Seen], expected_m: Floats) -> tuple[MarkMeasurement, ...]:
        self.single = frozenset()
        if not seen:
            return ()
        points = vision.triangulate(seen, expected_m, self._extent_m)
        most = self._most[points.n_views]
        wrong = (points.n_views > 1) & (points.misfit > most) | ~np.isfinite(points.misfit)
        measured = []
        for node, i in self._numbers.items():
            if not points.n_views[i]:
                continue
            if wrong[i]:
                detail = f"misfit {points.misfit[i]:.0f}, most {most[i]:.0f}"
                self.lost[node] = LostMark(node, Reason.APART, detail)
                continue
            self.lost.pop(node, None)
            shared = points.shared[i] if points.shared.shape[2] else None
            measured.append(MarkMeasurement(node, points.positions[i], points.covs[i], shared))
        self.single = frozenset(mark.node for mark in measured if points.n_views[self._numbers[mark.node]] == 1)
        return tuple(measured)


def calibration_shifts(scene: Scene) -> Callable[[Floats], Floats]:
    """Function from positions of triangulated marks [m], (n, 3), to their shifts by calibration errors [m], (n, 3, k).

    Each of the k errors is one standard deviation. If no camera sees a position, its shift is zero.
    """
    steps, extent_m = scene.calibration_steps, float(np.linalg.norm(np.ptp(scene.network.positions, axis=0)))

    def shifts(places_m: Floats) -> Floats:
        p = np.asarray(places_m, dtype=np.float64).reshape(-1, 3)
        seen = []
        for camera, own in zip(scene.space_cameras, steps, strict=True):
            inside, places_px, _ = camera.viewed(p)
            rows = np.flatnonzero(inside)
            if len(rows):
                covs_px2 = np.tile(np.eye(2), (len(rows), 1, 1))
                seen.append(vision.Seen(camera, rows.tolist(), places_px[rows], covs_px2, own))
        if not seen:
            return np.zeros((len(p), 3, steps[0].shape[0] if steps else 0))
        return vision.triangulate(seen, p, extent_m).shared

    return shifts
