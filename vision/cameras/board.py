"""Detection of calibration boards: corners of a chessboard or ChArUco board in a picture, with sub-pixel accuracy.

Board axes: x along a row of corners, y up the columns, z out of the print; the origin is the middle of all inner
corners. Image axes: u right, v down, the centre of the first pixel is (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from vision.arrays import Floats, Image
from vision.cameras.settings import DEFAULTS, CalibrationSettings
from vision.sources.frames import quiet_opencv

DICTIONARIES = tuple(sorted(name[5:] for name in dir(cv2.aruco) if name.startswith("DICT_") and name.isupper()))
"""Names of marker dictionaries, such as 4X4_50."""

SMALL_SQUARE_PX = 20.0
"""Side of a square in the reduced picture in which `larger_board` searches [px]; choice: at this size, corners are
still detectable."""


@dataclass(frozen=True, slots=True)
class Board:
    """A calibration board: a flat print of squares.

    columns, rows: number of inner corners along x and along y
    square_m: side of a square [m]
    dictionary: name of the marker dictionary of a ChArUco board; None for a chessboard
    marker_m: side of a marker of a ChArUco board [m]; None for a chessboard

    Raises ValueError that names the invalid field.
    """

    columns: int
    rows: int
    square_m: float
    dictionary: str | None = None
    marker_m: float | None = None

    def __post_init__(self) -> None:
        least = 3 if self.dictionary is None else 2
        if min(self.columns, self.rows) < least:
            raise ValueError(
                f"board: expected {least} or more inner corners each way, found {self.columns}x{self.rows}"
            )
        if not (np.isfinite(self.square_m) and self.square_m > 0):
            raise ValueError(f"board square_m: expected more than 0, found {self.square_m}")
        if (self.dictionary is None) != (self.marker_m is None):
            raise ValueError("board marker_m: expected a dictionary and a marker size together, found one of them")
        if self.dictionary is not None and self.dictionary not in DICTIONARIES:
            raise ValueError(f"board dictionary: expected one of {', '.join(DICTIONARIES)}, found {self.dictionary}")
        if self.dictionary is not None:
            printed, known = (self.columns + 1) * (self.rows + 1) // 2, len(_dictionary(self.dictionary).bytesList)
            if printed > known:
                raise ValueError(f"board dictionary: expected one of {printed} markers or more, found {known}")
        if self.marker_m is not None and not 0 < self.marker_m < self.square_m:
            raise ValueError(f"board marker_m: expected more than 0 and less than a square, found {self.marker_m}")

    @property
    def has_one_way_up(self) -> bool:
        """Whether the print looks different after a rotation by 180 degrees."""
        return self.dictionary is not None or (self.columns + self.rows) % 2 == 1

    @property
    def corners_m(self) -> Floats:
        """Positions of all inner corners in board axes [m], (columns * rows, 3), row by row from the upper left."""
        r, c = np.divmod(np.arange(self.columns * self.rows), self.columns)
        x, y = c - (self.columns - 1) / 2, (self.rows - 1) / 2 - r
        return self.square_m * np.stack([x, y, np.zeros(len(x))], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """Corners of a board. board_m: positions in board axes [m], (n, 3); seen_px: detected positions [px], (n, 2)."""

    board_m: Floats
    seen_px: Floats


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))


def find_board(board: Board, image: Image, settings: CalibrationSettings = DEFAULTS) -> Corners | None:
    """Corners of a board in a picture; None if the board is not found.

    image: (height, width) grey or (height, width, 3) BGR
    A chessboard must be completely visible. A ChArUco board needs settings.fewest_corners corners, not all collinear.
    """
    grey = np.asarray(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    with quiet_opencv():
        return (_chessboard if board.dictionary is None else _charuco)(board, grey, settings)


def _chessboard(board: Board, grey: Image, settings: CalibrationSettings) -> Corners | None:
    size = (board.columns, board.rows)
    found, rough = cv2.findChessboardCorners(
        grey, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    )
    if not found:  # the sector-based search finds some blurred boards that the first search misses, and vice versa
        found, rough = cv2.findChessboardCornersSB(grey, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not found:
        return None
    grid = _one_way_up(np.asarray(rough, dtype=np.float64).reshape(board.rows, board.columns, 2), grey, board)
    return Corners(board.corners_m, _refined(grey, grid.reshape(-1, 2), settings.corner_window * _least_distance(grid)))


def larger_board(board: Board, image: Image, corners: Corners) -> Board | None:
    """The board with one more column or one more row, if the picture shows this larger board; otherwise None.

    image: (height, width); to save time, only the part near the detected corners is searched
    """
    if board.dictionary is not None:
        return None
    px = corners.seen_px.reshape(board.rows, board.columns, 2)
    apart = _least_distance(px)
    (left, top), (right, bottom) = px.min(axis=(0, 1)) - 3.0 * apart, px.max(axis=(0, 1)) + 3.0 * apart
    part = image[max(int(top), 0) : int(bottom) + 1, max(int(left), 0) : int(right) + 1]
    scale = min(SMALL_SQUARE_PX / apart, 1.0)
    small = cv2.resize(part, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    with quiet_opencv():
        for larger in (replace(board, columns=board.columns + 1), replace(board, rows=board.rows + 1)):
            if cv2.findChessboardCorners(small, (larger.columns, larger.rows), flags=flags)[0]:
                return larger
    return None


def _least_distance(grid: Floats) -> float:
    return float(min(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)))


def _one_way_up(grid: Floats, grey: Image, board: Board) -> Floats:
    """The grid in the order of the board: its first square is dark or, if both ends look alike, x points right."""
    across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    faced = grid if across[0] * down[1] - across[1] * down[0] > 0 else grid[:, ::-1]
    if not board.has_one_way_up:
        turned = (faced[:, -1] - faced[:, 0])[:, 0].sum() < 0
    else:
        middles = (faced[1:, 1:] + faced[1:, :-1] + faced[:-1, 1:] + faced[:-1, :-1]) / 4
        v, u = np.rint(middles[..., 1]).astype(int), np.rint(middles[..., 0]).astype(int)
        levels = grey[v.clip(0, grey.shape[0] - 1), u.clip(0, grey.shape[1] - 1)].astype(np.float64)
        like_first = np.indices(levels.shape).sum(axis=0) % 2 == 0
        turned = levels[like_first].mean() > levels[~like_first].mean()
    return faced[::-1, ::-1] if turned else faced


def _charuco(board: Board, grey: Image, settings: CalibrationSettings) -> Corners | None:
    dictionary = _dictionary(str(board.dictionary))
    squares = (board.columns + 1, board.rows + 1)
    for before_opencv_46 in (False, True):  # an even number of rows allows markers on even or on odd squares
        printed = cv2.aruco.CharucoBoard(squares, float(board.square_m), float(board.marker_m or 0), dictionary)
        printed.setLegacyPattern(before_opencv_46)
        seen, ids, _, _ = cv2.aruco.CharucoDetector(printed).detectBoard(grey)
        if ids is not None and len(ids) >= settings.fewest_corners:
            break
    else:
        return None
    known = board.corners_m[np.ravel(ids)]
    places = np.asarray(seen, dtype=np.float64).reshape(-1, 2)
    if np.linalg.matrix_rank(known[:, :2] - known[0, :2]) < 2:
        return None
    apart = np.linalg.norm(places[:, None] - places[None], axis=2) + np.where(np.eye(len(places)), np.inf, 0.0)
    # Marker edges are not edges of squares: the window stays within the white around them.
    white = (1.0 - (board.marker_m or 0.0) / board.square_m) / 2
    return Corners(known, _refined(grey, places, min(settings.corner_window, white) * float(apart.min())))


def _refined(grey: Image, places: Floats, half_px: float) -> Floats:
    half = max(1, int(half_px))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    refined = cv2.cornerSubPix(
        grey, places.astype(np.float32).reshape(-1, 1, 2).copy(), (half, half), (-1, -1), criteria
    )
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2)
