"""Lenses and poses of cameras.

Camera axes: x right, y down, z forward, as in OpenCV. Image axes: u right, v down, in pixels. Lengths are in metres.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numba import njit

from vision.arrays import Floats

NEWTON_STEPS = 20
"""Largest number of Newton steps of the undistortion. For k1 = -0.3, four steps suffice even in a picture's corner."""


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Rigid motion of a point x to `rotation @ x + translation_m`. rotation: (3, 3); translation_m: [m], (3,)."""

    rotation: Floats
    translation_m: Floats

    def after(self, first: Pose) -> Pose:
        """Composition of two motions: first the motion `first`, then this motion."""
        return Pose(self.rotation @ first.rotation, self.rotation @ first.translation_m + self.translation_m)

    def inverse(self) -> Pose:
        """The inverse of this motion."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation_m)

    def moved(self, step: Floats) -> Pose:
        """A changed pose. step, (6,): rotation vector that acts from the left [rad], and shift of translation_m [m]."""
        return Pose(cv2.Rodrigues(step[:3])[0] @ self.rotation, self.translation_m + step[3:])


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """A lens, as in OpenCV.

    matrix: camera matrix [px], (3, 3)
    distortion: 5 coefficients k1 k2 p1 p2 k3, or 8 with k4 k5 k6 appended, or 12 with s1 s2 s3 s4 also appended

    The ideal position of a point is its position in a picture without distortion, for the same camera matrix.
    """

    matrix: Floats
    distortion: Floats
    _coefficients: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_coefficients", np.pad(self.distortion, (0, 12 - len(self.distortion))))

    def moved(self, step: Floats) -> Lens:
        """The lens with changed parameters. step: changes of fx fy cx cy [px] and of k1 k2 p1 p2 k3 [1], (9,)."""
        matrix = self.matrix.copy()
        matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += step[:4]
        distortion = self.distortion.copy()
        distortion[:5] += step[4:]
        return Lens(matrix, distortion)

    def distorted(self, ideal_px: Floats) -> tuple[Floats, Floats]:
        """Distorted positions, (n, 2), and their derivatives with respect to ideal_px, (n, 2, 2). ideal_px: (n, 2)."""
        return _distorted(np.ascontiguousarray(ideal_px), self.matrix, self._coefficients)

    def ideal(self, seen_px: Floats) -> Floats:
        """Ideal positions, (n, 2), from distorted positions, (n, 2). Raises ValueError if no ideal position exists."""
        ideal = seen_px.copy()
        for _ in range(NEWTON_STEPS):
            there, J = self.distorted(ideal)
            error = seen_px - there
            det = J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
            if not (det > 0).all():
                break
            if np.abs(error).max(initial=0.0) < 1e-9:
                return ideal
            ideal = (
                ideal
                + np.column_stack(
                    [
                        J[:, 1, 1] * error[:, 0] - J[:, 0, 1] * error[:, 1],
                        J[:, 0, 0] * error[:, 1] - J[:, 1, 0] * error[:, 0],
                    ]
                )
                / det[:, None]
            )
        raise ValueError("lens: expected places that its distortion reaches, found one beyond")


def by_calibration(lens: Lens, pose: Pose, points_m: Floats) -> Floats:
    """Derivatives of the projections [px] of points [m], (n, 3), with respect to lens and pose, (n, 2, 15).

    The 15 parameters are in the order of the columns of `Calibration.uncertainty`.
    """
    turned, zero = points_m @ pose.rotation.T, np.zeros(3)
    _, all_of_it = cv2.projectPoints(turned + pose.translation_m, zero, zero, lens.matrix, lens.distortion)
    # its columns: rotation about the camera, translation, fx fy, cx cy, k1 k2 p1 p2 k3, further lens parameters
    J = np.asarray(all_of_it, dtype=np.float64).reshape(len(points_m), 2, -1)[:, :, :15]
    by_rotation = np.cross(turned[:, None], J[:, :, 3:6])
    return np.concatenate([J[:, :, 6:], by_rotation, J[:, :, 3:6]], axis=2)


@njit(cache=True, nogil=True)
def _distorted(ideal, matrix, distortion):  # type: ignore[no-untyped-def]
    """Compiled part of `Lens.distorted`; distortion: all coefficients, (12,)."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = distortion
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    seen, J = np.empty(ideal.shape), np.empty((len(ideal), 2, 2))
    for i in range(len(ideal)):
        x, y = (ideal[i, 0] - cx) / fx, (ideal[i, 1] - cy) / fy
        r2 = x * x + y * y
        # OpenCV's model: radial x + 2 p1 x y + p2 (r² + 2 x²) + s1 r² + s2 r⁴,
        # radial y + p1 (r² + 2 y²) + 2 p2 x y + s3 r² + s4 r⁴; radial is a ratio of polynomials in r²
        above, below = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
        radial = above / below
        slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3) - radial * (k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6))
        slope = 2.0 * slope / below
        prism_x, prism_y = 2.0 * (s1 + 2.0 * s2 * r2), 2.0 * (s3 + 2.0 * s4 * r2)
        seen[i, 0] = cx + fx * (radial * x + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + r2 * s2))
        seen[i, 1] = cy + fy * (radial * y + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y) + r2 * (s3 + r2 * s4))
        cross = slope * x * y + 2.0 * (p1 * x + p2 * y)
        J[i, 0, 0] = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x + prism_x * x
        J[i, 0, 1] = (cross + prism_x * y) * fx / fy
        J[i, 1, 0] = (cross + prism_y * x) * fy / fx
        J[i, 1, 1] = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x + prism_y * y
    return seen, J
