"""Bundle adjustment of cameras and boards: least squares over all corners, with the covariance of the result.

World axes are the axes of the board on the plane. Camera axes: x right, y down, z forward, as in OpenCV. Unit: metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares

from vision.arrays import Floats
from vision.cameras.lens import Lens, Pose

N_LENS, N_CAMERA, N_BOARD = 9, 15, 6
"""Number of parameters of a lens (fx fy cx cy k1 k2 p1 p2 k3), a camera (lens, rotation, translation) and a board."""


class CalibrationError(ValueError):
    """Error for pictures that do not allow a calibration. The message says why, and what to do."""


WORST_CONDITION = 1e13
"""Largest accepted condition number of J'J. J is the Jacobian with normalised columns."""
TILT = "tilt the board by 20 to 40 degrees, another way in each picture"


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """The corners of one board in the picture of one camera.

    camera, board: indices of the camera and of the board in `Setup`
    board_m: the corners in board axes [m], (n, 3); seen_px: the detected corners in the picture [px], (n, 2)
    """

    camera: int
    board: int
    board_m: Floats
    seen_px: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Setup:
    """Lens of each camera, pose of each camera (world to camera), and pose of each board (board to world)."""

    lenses: tuple[Lens, ...]
    cameras: tuple[Pose, ...]
    boards: tuple[Pose, ...]

    def moved(self, step: Floats, plane: int) -> Setup:
        """The setup after a change of its parameters. The pose of the board with index `plane` does not change.

        step: changes of the 15 parameters of each camera, then of the 6 parameters of each board except `plane`, (n,)
        """
        n = len(self.cameras)
        ours, theirs = step[: N_CAMERA * n].reshape(n, N_CAMERA), step[N_CAMERA * n :].reshape(-1, N_BOARD)
        moved = {b: pose.moved(theirs[k]) for b, pose, k in self._free(plane)}
        return Setup(
            tuple(lens.moved(s[:N_LENS]) for lens, s in zip(self.lenses, ours, strict=True)),
            tuple(pose.moved(s[N_LENS:]) for pose, s in zip(self.cameras, ours, strict=True)),
            tuple(moved.get(b, pose) for b, pose in enumerate(self.boards)),
        )

    def _free(self, plane: int) -> list[tuple[int, Pose, int]]:
        return [(b, pose, b - (b > plane)) for b, pose in enumerate(self.boards) if b != plane]


@dataclass(frozen=True, slots=True, eq=False)
class Adjusted:
    """Result of a bundle adjustment.

    setup: fitted cameras and boards
    residuals_px: detected minus expected corners of each sighting [px], each (n, 2)
    cov: marginal covariance of the parameters of all cameras, (15 n_cameras, 15 n_cameras). The order of a camera's
        parameters is the order of the columns of `Calibration.uncertainty`.
    """

    setup: Setup
    residuals_px: tuple[Floats, ...]
    cov: Floats


def adjust(sightings: Sequence[Sighting], start: Setup, plane: int, sds_px: Sequence[float]) -> Adjusted:
    """Least-squares fit of lenses, poses of cameras and poses of boards.

    plane: index of the board that defines the world; its pose is fixed
    sds_px: standard deviation of the corners of each camera [px]. Only the ratios of these values matter: the residuals
        determine the scale of the covariance.

    Raises CalibrationError if the corners do not determine the parameters.
    """
    weights = [1.0 / sds_px[s.camera] for s in sightings]

    def residuals(step: Floats) -> Floats:
        setup = start.moved(step, plane)
        each = [w * _residuals(setup, s).ravel() for s, w in zip(sightings, weights, strict=True)]
        return np.concatenate(each)

    def jacobian(step: Floats) -> Floats:
        # _jacobian is for a small rotation after the step. The left Jacobian converts it to a change of the step.
        J = _jacobian(start.moved(step, plane), sightings, weights, plane)
        for first in _rotations(len(start.cameras), len(start.boards)):
            J[:, first : first + 3] = J[:, first : first + 3] @ _left_jacobian(step[first : first + 3])
        return J

    n = N_CAMERA * len(start.cameras) + N_BOARD * (len(start.boards) - 1)
    if sum(2 * len(s.seen_px) for s in sightings) <= n:
        raise CalibrationError("pictures: expected more corners than there are unknowns, found fewer")
    with np.errstate(all="ignore"):
        fit = least_squares(residuals, np.zeros(n), jac=jacobian, method="lm", x_scale="jac", max_nfev=200, xtol=1e-12)
    best = start.moved(fit.x, plane)
    J = _jacobian(best, sightings, weights, plane)
    variance = 2.0 * fit.cost / (len(fit.fun) - n)
    cov = variance * _inverse_of_square(J)[: N_CAMERA * len(start.cameras), : N_CAMERA * len(start.cameras)]
    return Adjusted(best, tuple(_residuals(best, s) for s in sightings), cov)


def project(lens: Lens, camera: Pose, points_m: Floats) -> Floats:
    """Project world points [m], (n, 3), to the picture [px], (n, 2)."""
    return _projected(lens, camera, points_m)[0]


def by_point(lens: Lens, camera: Pose, points_m: Floats) -> Floats:
    """Derivatives of projections by shifts along camera axes [px/m], (n, 2, 3); points_m: in world axes [m], (n, 3)."""
    return _projected(lens, camera, points_m)[1][:, :, 3:6]


def _projected(lens: Lens, camera: Pose, points_m: Floats) -> tuple[Floats, Floats]:
    # Points are transformed to camera axes here: OpenCV's rotation vectors are inexact near a half turn.
    points = points_m @ camera.rotation.T + camera.translation_m
    px, J = cv2.projectPoints(points, np.zeros(3), np.zeros(3), lens.matrix, lens.distortion)
    # columns of J: rotation vector, translation, fx fy, cx cy, k1 k2 p1 p2 k3
    return np.asarray(px, dtype=np.float64).reshape(-1, 2), np.asarray(J, dtype=np.float64).reshape(
        len(points_m), 2, -1
    )


def _residuals(setup: Setup, s: Sighting) -> Floats:
    seen_from = setup.cameras[s.camera].after(setup.boards[s.board])
    return s.seen_px - project(setup.lenses[s.camera], seen_from, s.board_m)


def _jacobian(setup: Setup, sightings: Sequence[Sighting], weights: Sequence[float], plane: int) -> Floats:
    """Jacobian of the weighted residuals at `setup`, with respect to the parameters that `Setup.moved` changes."""
    n_cameras = len(setup.cameras)
    n = N_CAMERA * n_cameras + N_BOARD * (len(setup.boards) - 1)
    blocks = []
    for s, weight in zip(sightings, weights, strict=True):
        camera, board = setup.cameras[s.camera], setup.boards[s.board]
        turned = s.board_m @ board.rotation.T
        world = turned + board.translation_m
        J = _projected(setup.lenses[s.camera], camera, world)[1]
        by_camera_point = J[:, :, 3:6]
        by_world_point = by_camera_point @ camera.rotation
        block = np.zeros((len(world), 2, n))
        k = N_CAMERA * s.camera
        block[:, :, k : k + N_LENS] = J[:, :, 6:15]
        block[:, :, k + N_LENS : k + N_LENS + 3] = -by_camera_point @ _cross(world @ camera.rotation.T)
        block[:, :, k + N_LENS + 3 : k + N_CAMERA] = by_camera_point
        if s.board != plane:
            k = N_CAMERA * n_cameras + N_BOARD * (s.board - (s.board > plane))
            block[:, :, k : k + 3] = -by_world_point @ _cross(turned)
            block[:, :, k + 3 : k + N_BOARD] = by_world_point
        blocks.append(-weight * block.reshape(-1, n))
    return np.concatenate(blocks)


def _rotations(n_cameras: int, n_boards: int) -> list[int]:
    """Index of the first component of each rotation in the parameter step of `Setup.moved`."""
    cameras = [N_CAMERA * c + N_LENS for c in range(n_cameras)]
    return cameras + [N_CAMERA * n_cameras + N_BOARD * b for b in range(n_boards - 1)]


def _cross(vectors: Floats) -> Floats:
    """Cross-product matrix of each of n vectors, (n, 3, 3): the matrix of v maps x to the cross product of v and x."""
    x, y, z = vectors.T
    o = np.zeros(len(vectors))
    return np.array([[o, -z, y], [z, o, -x], [-y, x, o]]).transpose(2, 0, 1)


def _left_jacobian(turn: Floats) -> Floats:
    """Left Jacobian of the rotation group at the rotation vector `turn`, (3, 3)."""
    angle = float(np.linalg.norm(turn))
    W = _cross(turn[None])[0]
    if angle < 1e-6:
        return np.eye(3) + W / 2
    return np.eye(3) + (1 - np.cos(angle)) / angle**2 * W + (angle - np.sin(angle)) / angle**3 * W @ W


def _inverse_of_square(J: Floats) -> Floats:
    """The inverse of J'J. The columns of J are normalised before the inversion."""
    lengths = np.linalg.norm(J, axis=0)
    if not (np.isfinite(lengths).all() and (lengths > 0).all()):
        raise CalibrationError(f"pictures: expected views that determine the camera, found none that do; {TILT}")
    scaled = J / lengths
    square = scaled.T @ scaled
    try:
        inverse = np.linalg.inv(square)
        condition = float(np.linalg.norm(square, 1) * np.linalg.norm(inverse, 1))
    except np.linalg.LinAlgError:
        condition = np.inf
    if not condition < WORST_CONDITION:
        raise CalibrationError(f"pictures: expected views that determine the camera, found too similar ones; {TILT}")
    return np.asarray((inverse + inverse.T) / 2 / np.outer(lengths, lengths), dtype=np.float64)
