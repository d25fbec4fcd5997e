"""Cameras of a scene in space: projection of points, rays of pixels, and uncertainty of the calibration.

World axes: x right, y up, z toward the viewer, in metres. Image axes: u right, v down, the centre of the first pixel is
(0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.arrays import Floats
from vision.cameras.lens import Lens, Pose, by_calibration

RADII = np.linspace(0.02, 4.0, 200)
"""Distances from mid-picture at which a test checks that a lens model is one-to-one [half diagonals]; numerical."""

SKEW = 1e-4
"""Largest error of a rotation's product with its transpose [1]; numerical: files round rotations."""

FAR_PX = 1e6
"""Distance from mid-picture beyond which `viewed` computes no distortion [px]; numerical: values may overflow there."""


@dataclass(frozen=True, slots=True, eq=False)
class SpaceCamera:
    """A calibrated camera in space.

    name: name of the camera
    size_px: width and height of its picture [px]
    lens: matrix and distortion
    pose: pose from world axes to camera axes
    calibration_sd_px: standard deviation on each axis of a position error that is independent for each mark [px]
    calibration: errors of lens and pose that all marks share, (n, 15), as in `Calibration.uncertainty`

    Raises ValueError that names the invalid field.
    """

    name: str
    size_px: tuple[int, int]
    lens: Lens
    pose: Pose
    calibration_sd_px: float = 0.0
    calibration: Floats = field(default_factory=lambda: np.zeros((0, 15)))
    fold_px: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if len(self.size_px) != 2 or min(self.size_px) < 1:
            raise ValueError(
                f"camera {self.name} size_px: expected width and height of at least 1, found {self.size_px}"
            )
        if not 0 <= self.calibration_sd_px < np.inf:
            raise ValueError(
                f"camera {self.name} calibration_sd_px: expected 0 or more, found {self.calibration_sd_px}"
            )
        matrix, rotation = np.asarray(self.lens.matrix), np.asarray(self.pose.rotation)
        if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or min(matrix[0, 0], matrix[1, 1]) <= 0.0:
            raise ValueError(f"camera {self.name} lens: expected a camera matrix, found {matrix.tolist()}")
        if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=SKEW):
            raise ValueError(f"camera {self.name} pose: expected a rotation, found {rotation.tolist()}")
        if np.linalg.det(rotation) < 0.0:
            raise ValueError(f"camera {self.name} pose: expected a rotation, found a reflection")
        if np.shape(self.pose.translation_m) != (3,) or not np.isfinite(self.pose.translation_m).all():
            raise ValueError(f"camera {self.name} pose: expected a translation, found {self.pose.translation_m}")
        calibration = np.array(self.calibration, dtype=np.float64).reshape(-1, 15)
        calibration.setflags(write=False)
        object.__setattr__(self, "calibration", calibration)
        object.__setattr__(self, "fold_px", _fold_px(self.lens, self.size_px))

    @property
    def centre_m(self) -> Floats:
        """Centre of the camera [m], (3,)."""
        return self.pose.inverse().translation_m

    def project(self, points_m: ArrayLike) -> Floats:
        """Project points [m], (n, 3), to the picture [px], (n, 2). Raises ValueError for a point behind the camera.

        The projection is valid only for points that are `in_view`: far outside the picture, the lens model may be
        wrong.
        """
        return self.seen(points_m)[0]

    def seen(self, points_m: ArrayLike) -> tuple[Floats, Floats]:
        """Projections of points [m], (n, 3), to the picture [px], (n, 2), and their derivatives [px/m], (n, 2, 3)."""
        p = np.asarray(points_m, dtype=float).reshape(-1, 3)
        ideal, depth = self._ideal(p)
        if not (depth > 0.0).all():
            behind = p[~(depth > 0.0)][0]
            raise ValueError(f"camera {self.name}: expected points before it, found {behind.tolist()}")
        return self._bent(ideal, depth)

    def ray(self, points_px: ArrayLike) -> tuple[Floats, Floats]:
        """Rays through picture positions [px], (n, 2): origin of all rays [m], (3,), and unit directions, (n, 3)."""
        ideal = self.lens.ideal(np.array(points_px, dtype=float).reshape(-1, 2))
        ways = (ideal - self.lens.matrix[:2, 2]) / self.lens.matrix[[0, 1], [0, 1]]
        directions = np.column_stack([ways, np.ones(len(ways))]) @ self.pose.rotation
        return self.centre_m, directions / np.linalg.norm(directions, axis=1, keepdims=True)

    def in_view(self, points_m: ArrayLike) -> NDArray[np.bool_]:
        """Whether each point [m], (n, 3), is in front of the camera and inside its picture, (n,)."""
        return self.viewed(points_m)[0]

    def viewed(self, points_m: ArrayLike) -> tuple[NDArray[np.bool_], Floats, Floats]:
        """Results of `in_view`, (n,), and `seen` for points [m], (n, 3); those of `seen` are NaN behind the camera."""
        ideal, depth = self._ideal(np.asarray(points_m, dtype=float).reshape(-1, 3))
        away = np.hypot(*(ideal - self.lens.matrix[:2, 2]).T)
        places, J = self._bent(np.where((away < FAR_PX)[:, None], ideal, np.nan), depth)
        inside = ((places >= -0.5) & (places <= np.array(self.size_px) - 0.5)).all(axis=1)
        return np.asarray(inside & (away < self.fold_px)), places, J

    def disc_shape(self, point_m: ArrayLike, normal: ArrayLike, radius_m: float) -> Floats:
        """Shape of a disc's image [px], (2, 2), see `Outline.shape_px`. point_m: centre [m], (3,); normal: (3,)."""
        _, _, axes = np.linalg.svd(np.reshape(normal, (1, 3)))
        return np.asarray(radius_m * self.seen(np.reshape(point_m, (1, 3)))[1][0] @ axes[1:].T, dtype=np.float64)

    def ball_shape(self, point_m: ArrayLike, radius_m: float) -> Floats:
        """Shape of a ball's image [px], (2, 2), see `Outline.shape_px`. point_m: ball centre [m], (3,)."""
        return self.disc_shape(point_m, np.reshape(point_m, 3) - self.centre_m, radius_m)

    def moved_by(self, points_m: ArrayLike, steps: Floats) -> Floats:
        """Shift of each projection due to each of k small errors of lens and pose [px], (n, 2, k).

        points_m: the projected points [m], (n, 3); steps: the errors, (k, 15), as in `Calibration.uncertainty`
        """
        p = np.asarray(points_m, dtype=float).reshape(-1, 3)
        return np.asarray(by_calibration(self.lens, self.pose, p) @ steps.T, dtype=np.float64)

    def _bent(self, ideal_px: Floats, depths_m: Floats) -> tuple[Floats, Floats]:
        """Compute the results of `seen` from ideal positions [px], (n, 2), and depths [m], (n,)."""
        focal, R = self.lens.matrix[[0, 1], [0, 1]], self.pose.rotation
        ways = (ideal_px - self.lens.matrix[:2, 2]) / focal
        # u = f x / z + c: du = f (dx - (x / z) dz) / z
        by_point = (R[:2] - ways[:, :, None] * R[2]) * focal[:, None] / depths_m[:, None, None]
        places, bent = self.lens.distorted(ideal_px)
        return places, bent @ by_point

    def _ideal(self, points_m: Floats) -> tuple[Floats, Floats]:
        """Ideal positions [px], (n, 2), and depths [m], (n,); a point behind the camera has the ideal position NaN."""
        at = points_m @ self.pose.rotation.T + self.pose.translation_m
        depth = at[:, 2]
        ways = at[:, :2] / np.where(depth > 0.0, depth, np.nan)[:, None]
        return ways * self.lens.matrix[[0, 1], [0, 1]] + self.lens.matrix[:2, 2], depth


@lru_cache(maxsize=16)
def _fold_px(lens: Lens, size_px: tuple[int, int]) -> float:
    """Radius of the circle about the principal point in which the lens model is one-to-one [px]."""
    radii, angles = 0.5 * np.hypot(*size_px) * RADII, 2.0 * np.pi * np.arange(16) / 16
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    bent = lens.distorted((lens.matrix[:2, 2] + radii[:, None, None] * ways).reshape(-1, 2))[1]
    folded = (np.linalg.det(bent).reshape(len(radii), -1) <= 0.0).any(axis=1)
    return float(radii[np.argmax(folded)]) if folded.any() else float(radii[-1])
