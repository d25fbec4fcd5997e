"""Calibration of a camera from pictures of a board: lens, pose relative to a plane, and their joint covariance.

World axes: x right and y up along the board on the plane, z toward the camera, the origin at the board's middle.
Sources: [brown1971] for the lens model, [zhang2000] for the calibration from planes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vision.arrays import Floats
from vision.cameras.board import Board, Corners
from vision.cameras.bundle import (
    N_LENS,
    TILT,
    Adjusted,
    CalibrationError,
    Setup,
    Sighting,
    adjust,
    by_point,
    project,
)
from vision.cameras.lens import Lens, Pose
from vision.cameras.settings import DEFAULTS, CalibrationSettings


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Board corners found in one picture, and the name of the picture."""

    name: str
    corners: Corners


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A calibrated camera: lens, pose and uncertainty, with the pictures and residuals of the calibration.

    name: name of the camera
    size_px: width and height of its pictures [px]
    lens: matrix and distortion k1 k2 p1 p2 k3
    plane_image: name of the picture whose board lies on the plane of the world
    pose: pose from world axes to camera axes
    uncertainty: square root U of the covariance U'U of lens and pose, (n, 15). The columns are fx fy cx cy [px], k1 k2
        p1 p2 k3 [1], a small rotation [rad] and a translation [m]. The rotation is in camera axes and applied from the
        left. Each row is the effect of one standard deviation of an independent error. If cameras were calibrated
        jointly, row i of each camera's matrix belongs to the same error.
    images_used: names of the used pictures; images_left_out: name and reason of each other picture, as "name: reason"
    views: for each used picture, the pose from board axes to camera axes
    seen_px: detected corners of each used picture [px], each (n, 2)
    residuals_px: detected minus expected corners of each used picture [px], each (n, 2)
    """

    name: str
    size_px: tuple[int, int]
    lens: Lens
    plane_image: str
    pose: Pose
    uncertainty: Floats
    images_used: tuple[str, ...]
    images_left_out: tuple[str, ...]
    views: tuple[Pose, ...]
    seen_px: tuple[Floats, ...]
    residuals_px: tuple[Floats, ...]

    @property
    def matrix(self) -> Floats:
        """Camera matrix [px], (3, 3)."""
        return self.lens.matrix

    @property
    def distortion(self) -> Floats:
        """Distortion coefficients k1 k2 p1 p2 k3, (5,)."""
        return self.lens.distortion

    @property
    def cov(self) -> Floats:
        """Covariance of fx fy cx cy k1 k2 p1 p2 k3, (9, 9)."""
        return self.joint_cov[:N_LENS, :N_LENS]

    @property
    def joint_cov(self) -> Floats:
        """Covariance of lens and pose, (15, 15), in the order of the columns of `uncertainty`."""
        return self.uncertainty.T @ self.uncertainty

    @property
    def matrix_sd(self) -> Floats:
        """Standard errors of fx fy cx cy [px], (4,)."""
        return np.sqrt(np.diag(self.cov))[:4]

    @property
    def distortion_sd(self) -> Floats:
        """Standard errors of k1 k2 p1 p2 k3, (5,)."""
        return np.sqrt(np.diag(self.cov))[4:]

    @property
    def reprojection_rms_px(self) -> float:
        """Root mean square distance between detected and expected corners [px]."""
        return rms(np.concatenate(self.residuals_px))

    @property
    def rms_px_each(self) -> Floats:
        """Root mean square distance between detected and expected corners for each picture [px], (n_images,)."""
        return np.array([rms(r) for r in self.residuals_px])

    @property
    def mm_per_px(self) -> Floats:
        """Width and height of a pixel on the plane at the picture's centre [mm], (2,)."""
        centre = (np.array(self.size_px, dtype=np.float64) - 1) / 2
        ray = np.append(cv2.undistortPoints(centre.reshape(1, 1, 2), self.matrix, self.distortion).ravel(), 1.0)
        normal = self.pose.rotation[:, 2]
        at = ray * (normal @ self.pose.translation_m) / (normal @ ray)
        point = self.pose.inverse().rotation @ (at - self.pose.translation_m)
        J = np.linalg.inv(by_point(self.lens, self.pose, point[None])[0] @ self.pose.rotation[:, :2])
        return np.asarray(1e3 * np.hypot(J[0], J[1]), dtype=np.float64)


def rms(residuals_px: Floats) -> float:
    """Root mean square length of residuals (n, 2) [px]."""
    return float(np.sqrt((residuals_px**2).sum(axis=1).mean()))


def calibrate(
    views: Sequence[View],
    size_px: tuple[int, int],
    plane: str | None = None,
    *,
    name: str = "camera",
    left_out: Sequence[str] = (),
    settings: CalibrationSettings = DEFAULTS,
) -> Calibration:
    """Calibrate a camera from views of a board.

    plane: name of the picture whose board lies on the plane of the world; default: the last used picture
    left_out: "name: reason" of each picture without a board; it is stored in the result

    Raises CalibrationError if there are fewer than settings.fewest_views views, if the views are too similar, or if the
    picture `plane` is not used.
    """
    used, dropped, lens = _without_outliers(views, size_px, [*left_out], settings)
    names = [view.name for view in used]
    if plane is not None and plane not in names:
        raise CalibrationError(f"{plane}: expected a picture of the board on the plane, found {_why(plane, dropped)}")
    fit, first = _adjusted(used, lens, len(used) - 1 if plane is None else names.index(plane))
    check_focal(fit.setup.lenses[0], fit.cov, settings)
    camera = fit.setup.cameras[0]
    return Calibration(
        name=name,
        size_px=size_px,
        lens=fit.setup.lenses[0],
        plane_image=names[first],
        pose=camera.after(upright(camera)),
        uncertainty=np.asarray(np.linalg.cholesky(fit.cov).T, dtype=np.float64),
        images_used=tuple(names),
        images_left_out=tuple(dropped),
        views=tuple(camera.after(board) for board in fit.setup.boards),
        seen_px=tuple(view.corners.seen_px for view in used),
        residuals_px=fit.residuals_px,
    )


def upright(camera: Pose) -> Pose:
    """Pose from new to old world axes: a turn about z by a multiple of 90°, after which x points nearly right."""
    across, up = camera.rotation[0, :2]
    quarter = int(np.rint(np.arctan2(up, across) / (np.pi / 2)))
    c, s = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[quarter % 4]
    return Pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))


def check_focal(lens: Lens, cov: Floats, settings: CalibrationSettings) -> None:
    """Raise CalibrationError if fx or fy is too uncertain; cov: covariance that begins with fx, fy [px²], (n, n)."""
    share = float((np.sqrt(np.diag(cov)[:2]) / lens.matrix[[0, 1], [0, 1]]).max())
    most = settings.largest_focal_sd
    if not share < most:
        raise CalibrationError(
            f"pictures: expected a focal length to {most:.0%}, found one to {share:.0%};"
            f" the views are too much alike: {TILT}"
        )


def board_text(board: Board) -> str:
    """Description of the board for messages."""
    if board.dictionary is None:
        return f"the board of {board.columns}x{board.rows} inner corners"
    return f"the ChArUco board of {board.columns + 1}x{board.rows + 1} squares"


def _without_outliers(
    views: Sequence[View], size_px: tuple[int, int], dropped: list[str], settings: CalibrationSettings
) -> tuple[list[View], list[str], tuple[Lens, list[Pose]]]:
    used = list(views)
    while True:
        if len(used) < settings.fewest_views:
            raise CalibrationError(
                f"pictures: expected the board in {settings.fewest_views} or more, found it in {len(used)}"
                f" of {len(used) + len(dropped)}; show all of it, sharp and evenly lit, and {TILT}"
            )
        lens, poses = _first_guess(used, size_px, settings)
        each = np.array(
            [rms(v.corners.seen_px - project(lens, p, v.corners.board_m)) for v, p in zip(used, poses, strict=True)]
        )
        middle = float(np.median(each))
        bad = each > settings.outlier_ratio * middle
        if not bad.any():
            return used, dropped, (lens, poses)
        dropped += [
            f"{v.name}: outlier, rms {e:.2f} px, median {middle:.2f}"
            for v, e, out in zip(used, each, bad, strict=True)
            if out
        ]
        used = [v for v, out in zip(used, bad, strict=True) if not out]


def _first_guess(
    views: Sequence[View], size_px: tuple[int, int], settings: CalibrationSettings
) -> tuple[Lens, list[Pose]]:
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-9)
    known = [v.corners.board_m.astype(np.float32) for v in views]
    seen = [v.corners.seen_px.astype(np.float32) for v in views]
    try:
        _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
            known, seen, size_px, np.eye(3), np.zeros(5), criteria=criteria
        )
    except cv2.error:
        raise CalibrationError(
            f"pictures: expected views that determine the camera, found none that do; {TILT}"
        ) from None
    still = Pose(np.eye(3), np.zeros(3))
    poses = [still.moved(np.concatenate([np.ravel(r), np.ravel(t)])) for r, t in zip(turns, shifts, strict=True)]
    normals = np.array([pose.rotation[:, 2] for pose in poses])
    if not (np.isfinite(normals).all() and np.isfinite(matrix).all() and np.isfinite(distortion).all()):
        raise CalibrationError(f"pictures: expected views that determine the camera, found none that do; {TILT}")
    widest = float(np.degrees(np.arccos(np.clip((normals @ normals.T).min(), -1.0, 1.0))))
    least = settings.least_tilt_deg
    if widest < least:
        raise CalibrationError(
            f"pictures: expected boards that face {least:.0f} degrees or more apart, found {widest:.1f};"
            f" the views are too much alike: {TILT}"
        )
    return Lens(np.asarray(matrix, dtype=np.float64), np.ravel(distortion).astype(np.float64)), poses


def _adjusted(views: Sequence[View], guess: tuple[Lens, list[Pose]], plane: int) -> tuple[Adjusted, int]:
    lens, poses = guess
    to_world = poses[plane].inverse()
    start = Setup((lens,), (poses[plane],), tuple(to_world.after(pose) for pose in poses))
    sightings = [Sighting(0, b, v.corners.board_m, v.corners.seen_px) for b, v in enumerate(views)]
    return adjust(sightings, start, plane, [1.0]), plane


def _why(name: str, dropped: Sequence[str]) -> str:
    reasons = [line.removeprefix(f"{name}: ") for line in dropped if line.startswith(f"{name}: ")]
    return reasons[0] if reasons else "no such picture"
