"""Figures that the settings of a calibration serve: errors of corners and cameras, pictures and sets accepted.

Boards are projected or drawn by a camera of known truth. `experiments.studies.settings.sensitivity` records what
half and twice of each setting cost.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from vision import (
    Board,
    Calibration,
    CalibrationError,
    CalibrationSettings,
    CameraViews,
    Corners,
    Lens,
    Pose,
    View,
    calibrate,
    calibrate_together,
    find_board,
)
from vision.arrays import Image
from vision.cameras.bundle import project

SIZE_PX = (400, 300)
LENS = Lens(
    np.array([[380.0, 0.0, 205.0], [0.0, 384.0, 147.0], [0.0, 0.0, 1.0]]), np.array([-0.22, 0.09, 1e-3, -8e-4, -0.02])
)
PINHOLE = Lens(LENS.matrix, np.zeros(5))
BOARD = Board(9, 6, 0.025)
CHARUCO = Board(8, 5, 0.025, "4X4_50", 0.018)
CORNER_SD_PX = 0.1
SEEDS = range(9200, 9206)


def calibration_figures(settings: CalibrationSettings) -> dict[str, float]:
    """Figures by name: errors are better when they are lower, counts of what is accepted when they are higher."""
    wrong_sets, good_sets = _sets_by_tilt(settings)
    return {
        "corner_error_px": _corner_error_px(settings),
        "charuco_pictures": float(_charuco_pictures(settings)),
        "focal_error_with_outlier": _focal_error_with_outlier(settings),
        "pictures_kept": float(_pictures_kept(settings)),
        "wrong_sets_accepted": float(wrong_sets),
        "good_sets_accepted": float(good_sets),
        "sets_of_few_accepted": float(sum(_done(_views(n, SEEDS[0]), settings) is not None for n in range(2, 12))),
        "pose_error_not_together_mm": _pose_error_mm(settings),
    }


def film_focal_sd(n_views: int) -> float:
    """Standard error of the focal length [1] from so many pictures of one film."""
    done = calibrate(_views(n_views, SEEDS[0]), SIZE_PX)
    return float(done.matrix_sd[0] / done.matrix[0, 0])


def _poses(n: int, rng: np.random.Generator, tilt_deg: tuple[float, float] = (18.0, 38.0)) -> list[Pose]:
    """Boards before the camera, each tilted another way."""
    poses = []
    for k in range(n):
        axis = np.array([np.cos(2.4 * k), np.sin(2.4 * k), 0.0])
        tilt = np.asarray(cv2.Rodrigues(axis * np.radians(rng.uniform(*tilt_deg)))[0])
        place = np.array([rng.uniform(-0.03, 0.03), rng.uniform(-0.02, 0.02), rng.uniform(0.34, 0.45)])
        poses.append(Pose(tilt @ np.diag([1.0, -1.0, -1.0]), place))
    return poses


def _seen(poses: Sequence[Pose], rng: np.random.Generator, sds_px: Sequence[float]) -> list[View]:
    """Views of the chessboard, each with its own error of corners [px]."""
    corners = BOARD.corners_m
    return [
        View(f"{k:02d}", Corners(corners, project(LENS, pose, corners) + rng.normal(0.0, sd, (len(corners), 2))))
        for k, (pose, sd) in enumerate(zip(poses, sds_px, strict=True))
    ]


def _views(n: int, seed: int) -> list[View]:
    rng = np.random.default_rng(seed)
    return _seen(_poses(n, rng), rng, [CORNER_SD_PX] * n)


def _done(views: Sequence[View], settings: CalibrationSettings) -> Calibration | None:
    try:
        return calibrate(views, SIZE_PX, settings=settings)
    except CalibrationError:
        return None


def _focal_error(done: Calibration) -> float:
    return float(abs(done.matrix[0, 0] / LENS.matrix[0, 0] - 1.0))


def _focal_error_with_outlier(settings: CalibrationSettings) -> float:
    """Root mean square relative error of the focal length where one view in nine is blurred, by four amounts."""
    squares = []
    for seed in SEEDS:
        for sd_px in (0.2, 0.4, 0.8, 1.6):
            rng = np.random.default_rng(seed)
            done = _done(_seen(_poses(9, rng), rng, [sd_px] + [CORNER_SD_PX] * 8), settings)
            squares.append(1.0 if done is None else _focal_error(done) ** 2)
    return float(np.sqrt(np.mean(squares)))


def _pictures_kept(settings: CalibrationSettings) -> int:
    """Pictures used of those whose errors differ by up to half."""
    n = 0
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        done = _done(
            _seen(_poses(9, rng), rng, [float(sd) for sd in rng.uniform(0.5, 1.5, 9) * CORNER_SD_PX]), settings
        )
        n += 0 if done is None else len(done.images_used)
    return n


def _sets_by_tilt(settings: CalibrationSettings) -> tuple[int, int]:
    """Sets accepted of boards that are tilted little: with an error of the focal length above 5 %, and below."""
    wrong = good = 0
    for seed in SEEDS:
        for tilt_deg in (0.0, 1.0, 2.0, 4.0, 6.0, 8.0, 10.0, 15.0):
            rng = np.random.default_rng(seed)
            views = _seen(_poses(6, rng, (0.8 * tilt_deg, tilt_deg)), rng, [0.3] * 6)
            done = _done(views, settings)
            wrong += done is not None and _focal_error(done) > 0.05
            good += done is not None and _focal_error(done) <= 0.05
    return wrong, good


def _pose_error_mm(settings: CalibrationSettings) -> float:
    """Root mean square error of the second camera's place [mm] where the board moves between two pictures of one name.

    Sets that are rejected count with the error that makes 1 px.
    """
    right = Pose(np.asarray(cv2.Rodrigues(np.array([0.0, 0.3, 0.0]))[0]), np.array([-0.1, 0.0, 0.02]))
    rejected_mm = 1e3 * 0.4 / float(LENS.matrix[0, 0])
    squares = []
    for seed in SEEDS:
        for moved_m in (0.0, 0.0005, 0.001, 0.002, 0.004):
            rng = np.random.default_rng(seed)
            poses = _poses(8, rng)
            moved = [Pose(p.rotation, p.translation_m + rng.normal(0.0, moved_m, 3)) for p in poses]
            sds = [CORNER_SD_PX] * 8
            left_views = CameraViews("left", SIZE_PX, tuple(_seen(poses, rng, sds)))
            right_views = CameraViews("right", SIZE_PX, tuple(_seen([right.after(p) for p in moved], rng, sds)))
            try:
                left, other = calibrate_together(BOARD, [left_views, right_views], settings=settings)
            except CalibrationError:
                squares.append(rejected_mm**2)
                continue
            between = other.pose.after(left.pose.inverse())
            squares.append(1e6 * float(((between.translation_m - right.translation_m) ** 2).sum()))
    return float(np.sqrt(np.mean(squares)))


def _picture(board: Board, pose: Pose, rng: np.random.Generator) -> Image:
    """The board as a pinhole camera sees it, drawn four times as fine, with blur and noise; (height, width) uint8."""
    square, fine = 60, 4
    columns, rows = board.columns + 1, board.rows + 1
    if board.dictionary is None:
        squares = np.where(np.indices((rows, columns)).sum(axis=0) % 2 == 1, 255, 0).astype(np.uint8)
        inner = np.kron(squares, np.ones((square, square), dtype=np.uint8))
    else:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{board.dictionary}"))
        printed = cv2.aruco.CharucoBoard((columns, rows), board.square_m, board.marker_m or 0.0, dictionary)
        inner = np.asarray(printed.generateImage((columns * square, rows * square), marginSize=0), dtype=np.uint8)
    texture = np.pad(inner.astype(np.float32), square, constant_values=255.0)
    # board metres (x right, y up from the middle) to pixels of the print, to pixels of the fine picture
    scale = square / board.square_m
    height, width = texture.shape
    to_print = np.array([[scale, 0.0, (width - 1) / 2.0], [0.0, -scale, (height - 1) / 2.0], [0.0, 0.0, 1.0]])
    to_fine = np.array([[fine, 0.0, (fine - 1) / 2.0], [0.0, fine, (fine - 1) / 2.0], [0.0, 0.0, 1.0]])
    to_picture = PINHOLE.matrix @ np.column_stack([pose.rotation[:, :2], pose.translation_m])
    H = to_fine @ to_picture @ np.linalg.inv(to_print)
    size = (fine * SIZE_PX[0], fine * SIZE_PX[1])
    light = cv2.warpPerspective(texture, H, size, borderMode=cv2.BORDER_CONSTANT, borderValue=110.0)
    small = light.reshape(SIZE_PX[1], fine, SIZE_PX[0], fine).mean(axis=(1, 3))
    levels = 35.0 + 170.0 / 255.0 * cv2.GaussianBlur(small, (0, 0), 0.7)
    return np.asarray(np.rint(levels + rng.normal(0.0, 2.0, levels.shape)).clip(0, 255), dtype=np.uint8)


def _corner_error_px(settings: CalibrationSettings) -> float:
    """Root mean square distance of corners found in drawn pictures from the truth [px]; 1 px where not found."""
    squares = []
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        for pose in _poses(2, rng):
            corners = find_board(BOARD, _picture(BOARD, pose, rng), settings)
            if corners is None:
                squares.append(1.0)
                continue
            errors = corners.seen_px - project(PINHOLE, pose, corners.board_m)
            squares.append(float((errors**2).sum(axis=1).mean()))
    return float(np.sqrt(np.mean(squares)))


def _charuco_pictures(settings: CalibrationSettings) -> int:
    """Pictures in which a ChArUco board is found that is pushed out of the picture step by step."""
    n = 0
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        pose = _poses(1, rng)[0]
        for shift_m in np.arange(0.0, 0.28, 0.02):
            pushed = Pose(pose.rotation, pose.translation_m + np.array([shift_m, 0.0, 0.0]))
            n += find_board(CHARUCO, _picture(CHARUCO, pushed, rng), settings) is not None
    return n
