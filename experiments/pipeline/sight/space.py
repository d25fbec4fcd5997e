"""Marks on a body in space, found in the pictures of several cameras and measured with all cameras that see them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

import vision
from estimators import MarkMeasurement
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.scene import Scene
from experiments.formats.scene.space_marks import across, facing, mark_shapes_px, outward
from experiments.pipeline.sight.plane import SIZE_SD
from vision import LostMark, Reason, SpaceCamera
from vision.arrays import Image
from vision.tracking.association import AssociatedMark
from vision.tracking.settings import STAGE_NAMES, FinderSettings

LEAST_COSINE = 0.3
"""Least cosine of the angle between the normal of a searched mark and the direction to the camera;
choice: 73 degrees. The detector rejects shapes whose width is below a quarter of their length."""

MISFIT = 1e-4
"""Least p-value of the distance between the rays to a mark [1]: below it, two cameras see different objects; choice:
equal to the finder's gate in one picture."""

PATIENCE, AGAIN = 3, 6
"""Number of frames after which a mark that a camera does not find counts as hidden, and interval in frames between
searches for hidden marks [1]; choice: each search covers the whole picture and is slow."""

STAGES = tuple(name for name in STAGE_NAMES if name != "other light")
"""Search stages of the finders, without the slowest: if changed light hides a mark from one camera, others see it."""


class CameraSight:
    """Finder of marks in the pictures of one camera.

    State: the finder; for each mark, the number of consecutive frames without it and the reason; the number of frames.
    """

    def __init__(self, camera: SpaceCamera, marks: Mapping[str, Mark], *, explain: bool) -> None:
        self.camera = camera
        settings = FinderSettings(stages=STAGES)
        self.finder = vision.MarkFinder([mark.hue for mark in marks.values()], settings, explain=explain)
        self.lost: dict[str, LostMark] = {}
        self._unseen = dict.fromkeys(marks, 0)
        self._n_frames = 0

    def find(
        self,
        image: Image,
        expected: Sequence[vision.Expected],
        after_impulse: Callable[[str], vision.Expected],
    ) -> list[AssociatedMark]:
        """The expected marks found in a picture, (height, width, 3) BGR; hidden marks are only sometimes searched."""
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


class SpaceSight:
    """Finds the measured marks of a scene in space in the pictures of its cameras, and measures their positions.

    A mark that several cameras see at one time is triangulated. If only one camera sees it, its position is on the
    camera's ray; its depth is unknown, so the standard deviation along the ray is the body's size.
    State: the finder of each camera; for the last exposure, expected positions of marks [m] and covariances [m²],
    reasons for lost marks, new distractors, and the marks that a single camera saw.
    """

    def __init__(self, scene: Scene, *, explain: bool = False) -> None:
        self.marks = {mark.node: mark for mark in scene.marks if mark.measured}
        self._marks = list(self.marks.values())
        self._numbers = {node: i for i, node in enumerate(self.marks)}
        self._normals = outward(scene, list(self.marks))
        self._discs = across(self._normals)
        self._extent_m = float(np.linalg.norm(np.ptp(scene.network.positions, axis=0)))
        self._steps = dict(zip((c.name for c in scene.space_cameras), scene.calibration_steps, strict=True))
        self.cameras = {c.name: CameraSight(c, self.marks, explain=explain) for c in scene.space_cameras}
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
        """The marks in pictures taken at one time; raises InputError for a picture of another size.

        predict: expected positions of the marks of nodes [m], (n, 3), and the covariances [m²], (n, 3, 3)
        after_impulse: the same for one node, if an impulse has acted on it since its mark was last found
        """
        means, covs = predict(list(self.marks))
        self.expected = dict(zip(self.marks, zip(means, covs, strict=True), strict=True))
        seen, self.lost, self.came = [], {}, ()
        for name, image in exposure.images.items():
            sight = self.cameras[name]
            check_size(sight.camera, image)
            expected, away = self._expected(sight.camera, means, covs)
            self.lost = away | self.lost
            found = sight.find(
                image,
                expected,
                lambda node, camera=sight.camera: self._one(camera, node, *after_impulse(node)),  # type: ignore[misc]
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
                        self._steps[name],
                    )
                )
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

    def _expected(
        self, camera: SpaceCamera, means: Floats, covs: Floats
    ) -> tuple[list[vision.Expected], dict[str, LostMark]]:
        """The marks that a camera may see now, and why it cannot see the others."""
        inside, places, J = camera.viewed(means)
        visible = inside & facing(camera, means, self._normals, LEAST_COSINE)
        away = {
            node: LostMark(node, Reason.AWAY if inside[i] else Reason.OUTSIDE)
            for node, i in self._numbers.items()
            if not visible[i]
        }
        rows = np.flatnonzero(visible)
        if not len(rows):
            return [], away
        covs_px2 = J[rows] @ covs[rows] @ J[rows].transpose(0, 2, 1)
        if len(camera.calibration):
            by = camera.calibration_error_px(means[rows])
            covs_px2 = covs_px2 + by @ by.transpose(0, 2, 1)
        return self._looked_for(camera, rows, means[rows], places[rows], J[rows], covs_px2), away

    def _one(self, camera: SpaceCamera, node: str, mean: Floats, cov: Floats) -> vision.Expected:
        places, J = camera.seen(mean[None])
        rows = np.array([self._numbers[node]])
        return self._looked_for(camera, rows, mean[None], places, J, J @ cov @ J.transpose(0, 2, 1))[0]

    def _looked_for(
        self,
        camera: SpaceCamera,
        rows: NDArray[np.int64],
        means: Floats,
        places_px: Floats,
        by_place: Floats,
        covs_px2: Floats,
    ) -> list[vision.Expected]:
        marks = [self._marks[i] for i in rows.tolist()]
        shapes = mark_shapes_px(marks, camera, means, self._discs[rows], by_place)
        return [
            vision.Expected(
                mark.node, places_px[k], covs_px2[k], mark.hue_deg, vision.Outline(shapes[k], SIZE_SD, mark.even)
            )
            for k, mark in enumerate(marks)
        ]


def check_size(camera: SpaceCamera, image: Image) -> None:
    """Raise InputError if a picture's size differs from that of its camera."""
    height, width = image.shape[:2]
    if camera.size_px != (width, height):
        found = f"[{width}, {height}]"
        raise InputError.at(f"picture of camera {camera.name}", str(list(camera.size_px)), found)


def calibration_shifts(scene: Scene) -> Callable[[Floats], Floats]:
    """Function from positions of marks [m], (n, 3), to their shifts by one sd of each calibration error [m], (n, 3, k).

    A shift is that of the triangulated position; it is zero for a position that no camera sees.
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
