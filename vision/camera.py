"""Cameras that look at a flat scene: homographies between the plane and the picture, and covariances through them.

Image axes: u right, v down, the centre of the first pixel is (0, 0). Plane axes: x right, y up, metres.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PlaneCamera:
    """A calibrated view of one plane.

    name: what the camera is called
    size_px: width and height of its picture [px]
    plane_to_px: homography from the plane [m] to the picture [px], shape (3, 3), up to scale
    calibration_sd_px: what the calibration itself may be off by [px], one standard deviation an axis

    Raises ValueError that names the field.
    """

    name: str
    size_px: tuple[int, int]
    plane_to_px: Floats
    calibration_sd_px: float = 0.0
    px_to_plane: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if len(self.size_px) != 2 or min(self.size_px) < 1:
            raise ValueError(
                f"camera {self.name} size_px: expected width and height of at least 1, found {self.size_px}"
            )
        homography = np.array(self.plane_to_px, dtype=np.float64)
        if homography.shape != (3, 3):
            raise ValueError(f"camera {self.name} plane_to_px: expected shape (3, 3), found {homography.shape}")
        if not np.isfinite(homography).all():
            raise ValueError(f"camera {self.name} plane_to_px: expected finite numbers, found {homography.tolist()}")
        if not (np.isfinite(self.calibration_sd_px) and self.calibration_sd_px >= 0):
            raise ValueError(
                f"camera {self.name} calibration_sd_px: expected 0 or more, found {self.calibration_sd_px}"
            )
        inverse = _inverse(self.name, homography)
        centre = np.array([(self.size_px[0] - 1) / 2.0, (self.size_px[1] - 1) / 2.0, 1.0])
        # The sign of a homography is free. Here the third coordinate is positive for all that lies before the camera.
        sign = float(np.sign(inverse[2] @ centre))
        if sign == 0:
            raise ValueError(
                f"camera {self.name} plane_to_px: expected the plane in view, found its horizon mid-picture"
            )
        for key, value in (("plane_to_px", homography * sign), ("px_to_plane", inverse * sign)):
            value.setflags(write=False)
            object.__setattr__(self, key, value)

    def project(self, points_m: ArrayLike) -> Floats:
        """Where points of the plane [m], (n, 2), are seen [px], (n, 2); ValueError for points beyond the horizon."""
        return self._mapped(self.plane_to_px, points_m)[0]

    def to_plane(self, points_px: ArrayLike) -> Floats:
        """Points of the plane [m], (n, 2), seen at these places [px], (n, 2); ValueError beyond the horizon."""
        return self._mapped(self.px_to_plane, points_px)[0]

    def cov_to_plane(self, points_px: ArrayLike, covs_px: ArrayLike) -> Floats:
        """Covariances on the plane [m²], (n, 2, 2), of places seen [px], (n, 2), with covariances [px²], (n, 2, 2)."""
        J = self._mapped(self.px_to_plane, points_px)[1]
        return J @ np.asarray(covs_px, dtype=float).reshape(-1, 2, 2) @ J.transpose(0, 2, 1)

    def cov_to_px(self, points_m: ArrayLike, covs_m: ArrayLike) -> Floats:
        """Covariances in the picture [px²], (n, 2, 2), of points [m], (n, 2), with covariances [m²], (n, 2, 2)."""
        J = self._mapped(self.plane_to_px, points_m)[1]
        return J @ np.asarray(covs_m, dtype=float).reshape(-1, 2, 2) @ J.transpose(0, 2, 1)

    def mm_per_px(self, point_m: ArrayLike) -> Floats:
        """How far one pixel reaches on the plane at that point, across and down [mm], shape (2,)."""
        J = self._mapped(self.px_to_plane, self.project(np.reshape(point_m, (1, 2))))[1][0]
        return np.asarray(1e3 * np.hypot(J[0], J[1]), dtype=np.float64)

    def _mapped(self, homography: Floats, points: ArrayLike) -> tuple[Floats, Floats]:
        """The points mapped, (n, 2), and the Jacobian of the map at each, (n, 2, 2)."""
        p = np.asarray(points, dtype=float).reshape(-1, 2)
        q = p @ homography[:, :2].T + homography[:, 2]
        w = q[:, 2:]
        if not (w > 0).all():
            beyond = p[~(w[:, 0] > 0)][0]
            raise ValueError(f"camera {self.name}: expected points before the horizon, found {beyond.tolist()}")
        mapped = q[:, :2] / w
        # d(q_i / w) / dp_j = (H_ij - (q_i / w) H_3j) / w
        J = (homography[:2, :2] - mapped[:, :, None] * homography[2, :2]) / w[:, :, None]
        return mapped, J


def _inverse(name: str, homography: Floats) -> Floats:
    # Metres against pixels put factors of 1000 between the columns: scale them out before the rank is judged.
    columns = np.linalg.norm(homography, axis=0)
    rows = np.linalg.norm(homography / np.where(columns > 0, columns, 1.0), axis=1)
    scaled = homography / np.where(columns > 0, columns, 1.0) / np.where(rows > 0, rows, 1.0)[:, None]
    if np.linalg.cond(scaled) > 1e12:
        raise ValueError(f"camera {name} plane_to_px: expected an invertible matrix, found {homography.tolist()}")
    return np.asarray(np.linalg.inv(homography), dtype=np.float64)


def squarely(
    name: str,
    size_px: tuple[int, int],
    mm_per_px: tuple[float, float],
    centre_m: tuple[float, float] = (0.0, 0.0),
    *,
    calibration_sd_px: float = 0.0,
) -> PlaneCamera:
    """A camera square to the plane: its picture's centre sees centre_m [m], one pixel is mm_per_px wide and high."""
    if not min(mm_per_px) > 0:
        raise ValueError(f"camera {name} mm_per_px: expected more than 0, found {mm_per_px}")
    across, down = 1e3 / mm_per_px[0], 1e3 / mm_per_px[1]
    u0, v0 = (size_px[0] - 1) / 2.0, (size_px[1] - 1) / 2.0
    # u = u0 + (x - x0) across, v = v0 - (y - y0) down
    homography = np.array(
        [[across, 0.0, u0 - across * centre_m[0]], [0.0, -down, v0 + down * centre_m[1]], [0.0, 0.0, 1.0]]
    )
    return PlaneCamera(name, size_px, homography, calibration_sd_px)
