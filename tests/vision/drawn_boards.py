"""Boards drawn as a known camera sees them: ray by ray, averaged over sub-pixels, blurred, with noise."""

import cv2
import numpy as np

from vision import Board, Corners, Lens, Pose, View

SIZE_PX = (400, 300)
LENS = Lens(
    np.array([[380.0, 0.0, 205.0], [0.0, 384.0, 147.0], [0.0, 0.0, 1.0]]), np.array([-0.22, 0.09, 1e-3, -8e-4, -0.02])
)
BOARD = Board(9, 6, 0.025)
SUB = 3
"""Rays across a pixel and down it."""


def seen(lens: Lens, pose: Pose, points_m: np.ndarray) -> np.ndarray:
    """Where OpenCV sees points [px]."""
    turn = cv2.Rodrigues(pose.rotation)[0]
    return cv2.projectPoints(points_m, turn, pose.translation_m, lens.matrix, lens.distortion)[0].reshape(-1, 2)


def sub_pixel_rays(lens: Lens) -> np.ndarray:
    """Directions x/z, y/z of all sub-pixels, (2, height * sub * width * sub), to 0.003 px."""
    offsets = (np.arange(SUB) + 0.5) / SUB - 0.5
    u = (np.arange(SIZE_PX[0])[:, None] + offsets).ravel()
    v = (np.arange(SIZE_PX[1])[:, None] + offsets).ravel()
    px = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    return cv2.undistortPoints(px[:, None], lens.matrix, lens.distortion).reshape(-1, 2).T.astype(np.float32)


def print_of(board: Board, per_square: int = 60, *, legacy: bool = False) -> np.ndarray:
    """The board's print with a white margin of one square, per_square pixels a square.

    legacy: of a ChArUco board, as OpenCV printed it before 4.6
    """
    across, down = board.columns + 1, board.rows + 1
    if board.dictionary is None:
        r, c = np.indices((down, across))
        squares = np.where((r + c) % 2 == 0, 0, 255).astype(np.uint8)
        inner = np.kron(squares, np.ones((per_square, per_square), dtype=np.uint8))
    else:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{board.dictionary}"))
        printed = cv2.aruco.CharucoBoard((across, down), board.square_m, board.marker_m, dictionary)
        printed.setLegacyPattern(legacy)
        inner = printed.generateImage((across * per_square, down * per_square), marginSize=0)
    return np.pad(inner, per_square, constant_values=255)


def drawn(board: Board, pose: Pose, rays: np.ndarray, *, rng: np.random.Generator, legacy: bool = False) -> np.ndarray:
    """The board in grey light, (height, width) uint8; `rays` are those of `sub_pixel_rays`."""
    texture = print_of(board, legacy=legacy)
    per_square = texture.shape[1] / (board.columns + 3)
    # The ray's point on the plane z = 0 of the board, homogeneous, then in squares from the print's upper left
    to_plane = np.linalg.inv(np.column_stack([pose.rotation[:, :2], pose.translation_m])).astype(np.float32)
    x, y, w = to_plane[:, :2] @ rays + to_plane[:, 2:]
    c = (x / w / board.square_m + (board.columns + 3) / 2) * per_square - 0.5
    r = ((board.rows + 3) / 2 - y / w / board.square_m) * per_square - 0.5
    grid = (SIZE_PX[1] * SUB, SIZE_PX[0] * SUB)
    bright, border = 35.0 + 170.0 / 255.0 * texture.astype(np.float32), cv2.BORDER_CONSTANT
    at = c.reshape(grid), r.reshape(grid)
    light = cv2.remap(bright, *at, cv2.INTER_LINEAR, borderMode=border, borderValue=110.0)
    shape = (SIZE_PX[1], SUB, SIZE_PX[0], SUB)
    picture = cv2.GaussianBlur(light.reshape(shape).mean(axis=(1, 3)), (0, 0), 0.7)
    return np.rint(picture + rng.normal(0.0, 2.0, picture.shape)).clip(0, 255).astype(np.uint8)


def poses(n: int, rng: np.random.Generator, *, far_m: float = 0.36) -> list[Pose]:
    """Boards before the camera, face to it, each tilted another way."""
    made = []
    for k in range(n):
        axis = np.array([np.cos(2.4 * k), np.sin(2.4 * k), 0.0])
        tilt = cv2.Rodrigues(axis * np.radians(rng.uniform(18.0, 38.0)))[0]
        roll = cv2.Rodrigues(np.array([0.0, 0.0, rng.uniform(-0.25, 0.25)]))[0]
        place = np.array([rng.uniform(-0.03, 0.03), rng.uniform(-0.02, 0.02), far_m * rng.uniform(0.95, 1.25)])
        made.append(Pose(tilt @ roll @ np.diag([1.0, -1.0, -1.0]), place))
    return made


def noisy_views(board: Board, lens: Lens, at: list[Pose], sd_px: float, rng: np.random.Generator) -> list[View]:
    """Corners of the boards where the camera sees them, each off by Gaussian noise [px]."""
    corners = board.corners_m
    return [
        View(f"{k:02d}.png", Corners(corners, seen(lens, pose, corners) + rng.normal(0.0, sd_px, (len(corners), 2))))
        for k, pose in enumerate(at)
    ]
