"""Joint calibration of several cameras of one scene, from simultaneous pictures of a board."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vision.cameras.board import Board
from vision.cameras.bundle import N_CAMERA, Adjusted, CalibrationError, Setup, Sighting, adjust
from vision.cameras.calibration import Calibration, View, calibrate, check_focal, rms, upright
from vision.cameras.lens import Pose
from vision.cameras.settings import DEFAULTS, CalibrationSettings


@dataclass(frozen=True, slots=True, eq=False)
class CameraViews:
    """Pictures of one camera for a calibration. size_px: width and height of a picture [px].

    views: the pictures in which the board was found; left_out: "name: reason" of each other picture
    """

    name: str
    size_px: tuple[int, int]
    views: tuple[View, ...]
    left_out: tuple[str, ...] = ()


def calibrate_together(
    board: Board,
    cameras: Sequence[CameraViews],
    plane: str | None = None,
    *,
    settings: CalibrationSettings = DEFAULTS,
) -> list[Calibration]:
    """Calibrate each camera alone, then all cameras jointly.

    cameras: views of each camera. Views of equal name must show the board in the same pose.
    plane: name of the picture whose board defines the world axes; default: the last picture that the first camera used.
        In the pictures of the first camera, the world's x axis points nearly to the right.

    Raises CalibrationError if `calibrate` raises it for a camera, if the board looks the same after a half turn, if no
    common pictures connect the cameras, or if pictures of equal name were not simultaneous.
    """
    if not board.has_one_way_up:
        raise CalibrationError(
            f"board: expected one whose columns and rows are odd and even, found {board.columns}x{board.rows};"
            " turned around it looks the same, and two cameras could take different corners for the first"
        )
    alone = [_alone(camera, settings) for camera in cameras]
    used = [set(one.images_used) for one in alone]
    world = plane if plane is not None else alone[0].images_used[-1]
    if not any(world in names for names in used):
        raise CalibrationError(f"{world}: expected a picture of the board on the plane, found none used by a camera")
    poses, boards = _joined(alone, world)
    names = sorted(boards)
    start = Setup(tuple(one.lens for one in alone), tuple(poses), tuple(boards[name] for name in names))
    sightings = [
        Sighting(c, names.index(view.name), view.corners.board_m, view.corners.seen_px)
        for c, camera in enumerate(cameras)
        for view in camera.views
        if view.name in used[c]
    ]
    fit = adjust(sightings, start, names.index(world), [one.reprojection_rms_px for one in alone])
    return _records(alone, fit, sightings, names, world, settings)


def _alone(camera: CameraViews, settings: CalibrationSettings) -> Calibration:
    try:
        return calibrate(camera.views, camera.size_px, name=camera.name, left_out=camera.left_out, settings=settings)
    except CalibrationError as error:
        raise CalibrationError(f"camera {camera.name}: {error}") from None


def _joined(alone: Sequence[Calibration], world: str) -> tuple[list[Pose], Mapping[str, Pose]]:
    """Initial poses of the cameras (world to camera axes), and of the boards by picture name (board to world axes)."""
    boards: dict[str, Pose] = {world: Pose(np.eye(3), np.zeros(3))}
    poses: dict[int, Pose] = {}
    while len(poses) < len(alone):
        tied = [
            (c, name) for c in range(len(alone)) if c not in poses for name in alone[c].images_used if name in boards
        ]
        if not tied:
            lonely = next(one.name for c, one in enumerate(alone) if c not in poses)
            raise CalibrationError(
                f"camera {lonely}: expected pictures named as those of the other cameras, in which both see the board,"
                " found none"
            )
        c, name = min(tied, key=lambda tie: alone[tie[0]].rms_px_each[alone[tie[0]].images_used.index(tie[1])])
        seen = dict(zip(alone[c].images_used, alone[c].views, strict=True))
        poses[c] = seen[name].after(boards[name].inverse())
        for other, pose in seen.items():
            boards.setdefault(other, poses[c].inverse().after(pose))
    return [poses[c] for c in range(len(alone))], boards


def _records(
    alone: Sequence[Calibration],
    fit: Adjusted,
    sightings: Sequence[Sighting],
    names: Sequence[str],
    world: str,
    settings: CalibrationSettings,
) -> list[Calibration]:
    turn = upright(fit.setup.cameras[0])
    factor = np.asarray(np.linalg.cholesky(fit.cov).T, dtype=np.float64)
    records = []
    for c, one in enumerate(alone):
        lens, pose = fit.setup.lenses[c], fit.setup.cameras[c]
        mine = slice(N_CAMERA * c, N_CAMERA * (c + 1))
        residuals = tuple(r for s, r in zip(sightings, fit.residuals_px, strict=True) if s.camera == c)
        joint, own = rms(np.concatenate(residuals)), one.reprojection_rms_px
        if joint > own + settings.together_px:
            raise CalibrationError(
                f"camera {one.name}: expected pictures of the same name taken together, found {joint:.1f} px rms"
                f" with the others and {own:.1f} px alone"
            )
        check_focal(lens, fit.cov[mine, mine], settings)
        views = tuple(pose.after(fit.setup.boards[names.index(name)]) for name in one.images_used)
        records.append(
            replace(
                one,
                lens=lens,
                plane_image=world,
                pose=pose.after(turn),
                uncertainty=factor[:, mine],
                views=views,
                residuals_px=residuals,
            )
        )
    return records
