"""Cameras of a flat scene: homographies between the plane and the picture, and covariances through them.

Image axes: u right, v down, the centre of the first pixel is (0, 0). Plane axes: x right, y up, in metres.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from vision.arrays import Floats
from vision.cameras.lens import Lens, Pose, by_calibration

DISC = np.array(
    [[0.0, 0.0], *(np.sqrt(2.0 / 3.0) * np.array([np.cos(a), np.sin(a)]) for a in np.pi / 3.0 * np.arange(6))]
)
DISC_WEIGHTS = np.array([0.25, *[0.125] * 6])
"""Weights of the points `DISC`. For polynomials up to degree 5, the weighted mean is the mean over the unit disc."""


@dataclass(frozen=True, slots=True, eq=False)
class PlaneCamera:
    """A calibrated camera for one plane: the mapping between plane and picture, with its uncertainty.

    name: name of the camera
    size_px: width and height of its picture [px]
    plane_to_px: homography from the plane [m] to the picture [px], shape (3, 3); its scale is arbitrary
    calibration_sd_px: standard deviation on each axis of a position error that is independent for each mark [px]
    lens: lens whose distortion acts after the homography; None: no distortion
    calibration: errors of lens and pose that all marks share, (n, 15), as in `Calibration.uncertainty`
    scale_sd: relative standard deviation of the scale in millimetres per pixel [1]; None: not stated. All marks share
        the error of the scale.

    Raises ValueError that names the invalid field.
    """

    name: str
    size_px: tuple[int, int]
    plane_to_px: Floats
    calibration_sd_px: float = 0.0
    lens: Lens | None = None
    calibration: Floats = field(default_factory=lambda: np.zeros((0, 15)))
    scale_sd: float | None = None
    px_to_plane: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if len(self.size_px) != 2 or min(self.size_px) < 1:
            raise ValueError(
                f"camera {self.name} size_px: expected width and height of at least 1, found {self.size_px}"
            )
        calibration = np.array(self.calibration, dtype=np.float64).reshape(-1, 15)
        if len(calibration) and self.lens is None:
            raise ValueError(f"camera {self.name} calibration: expected a lens beside it, found none")
        homography = np.array(self.plane_to_px, dtype=np.float64)
        if homography.shape != (3, 3):
            raise ValueError(f"camera {self.name} plane_to_px: expected shape (3, 3), found {homography.shape}")
        if not np.isfinite(homography).all():
            raise ValueError(f"camera {self.name} plane_to_px: expected finite numbers, found {homography.tolist()}")
        if not (np.isfinite(self.calibration_sd_px) and self.calibration_sd_px >= 0):
            raise ValueError(
                f"camera {self.name} calibration_sd_px: expected 0 or more, found {self.calibration_sd_px}"
            )
        if self.scale_sd is not None and not 0 <= self.scale_sd < np.inf:
            raise ValueError(f"camera {self.name} scale_sd: expected 0 or more, found {self.scale_sd}")
        inverse = _inverse(self.name, homography)
        centre = np.array([(self.size_px[0] - 1) / 2.0, (self.size_px[1] - 1) / 2.0, 1.0])
        # The sign of a homography is arbitrary: here the third coordinate is positive for points before the camera.
        sign = float(np.sign(inverse[2] @ centre))
        if sign == 0:
            raise ValueError(
                f"camera {self.name} plane_to_px: expected the plane in view, found its horizon mid-picture"
            )
        for key, value in (
            ("plane_to_px", homography * sign),
            ("px_to_plane", inverse * sign),
            ("calibration", calibration),
        ):
            value.setflags(write=False)
            object.__setattr__(self, key, value)

    def moved(self, rotation: ArrayLike, translation_m: ArrayLike) -> PlaneCamera:
        """The same camera with other plane axes. Point x in the new axes is point `R @ x + t` in the present axes.

        rotation: R, (2, 2); translation_m: t [m], (2,)
        """
        motion = np.eye(3)
        motion[:2, :2], motion[:2, 2] = rotation, translation_m
        return replace(self, plane_to_px=self.plane_to_px @ motion)

    def project(self, points_m: ArrayLike) -> Floats:
        """Map plane points [m], (n, 2), to the picture [px], (n, 2). Raises ValueError for points past the horizon."""
        return self._seen(points_m)[0]

    def to_plane(self, points_px: ArrayLike) -> Floats:
        """Map pixels [px], (n, 2), to the plane [m], (n, 2). Raises ValueError for pixels past the horizon."""
        return self._seen_from(points_px)[0]

    def cov_to_plane(self, points_px: ArrayLike, covs_px: ArrayLike) -> Floats:
        """Map covariances in the picture [px²] to the plane [m²], each (n, 2, 2), at picture positions [px], (n, 2)."""
        J = self._seen_from(points_px)[1]
        return J @ np.asarray(covs_px, dtype=float).reshape(-1, 2, 2) @ J.transpose(0, 2, 1)

    def cov_to_px(self, points_m: ArrayLike, covs_m: ArrayLike) -> Floats:
        """Map covariances on the plane [m²] to the picture [px²], each (n, 2, 2), at plane points [m], (n, 2)."""
        J = self._seen(points_m)[1]
        return J @ np.asarray(covs_m, dtype=float).reshape(-1, 2, 2) @ J.transpose(0, 2, 1)

    def mm_per_px(self, point_m: ArrayLike) -> Floats:
        """Width and height of a pixel on the plane at a point [mm], shape (2,)."""
        J = self._seen_from(self.project(np.reshape(point_m, (1, 2))))[1][0]
        return np.asarray(1e3 * np.hypot(J[0], J[1]), dtype=np.float64)

    def disc_shape(self, point_m: ArrayLike, radius_m: float) -> Floats:
        """Shape of a disc's image [px], (2, 2), as in `Outline.shape_px`. The disc lies on the plane."""
        return np.asarray(radius_m * self._seen(np.reshape(point_m, (1, 2)))[1][0], dtype=np.float64)

    def ball_shape(self, point_m: ArrayLike, radius_m: float) -> Floats:
        """Shape of a ball's image [px], (2, 2), as in `Outline.shape_px`. The ball's centre lies on the plane.

        The image is assumed to be a circle, because the tilt of the plane does not foreshorten a ball. The radius of
        the circle is the ball's radius times the largest singular value of the projection's Jacobian. Away from
        mid-picture, the true image is an ellipse, longer by 1 / cos of the angle between ray and optical axis.
        """
        J = self._seen(np.reshape(point_m, (1, 2)))[1][0]
        return np.asarray(radius_m * np.linalg.norm(J, 2) * np.eye(2), dtype=np.float64)

    def disc_shift(self, points_m: ArrayLike, radius_m: ArrayLike) -> Floats:
        """Centre of gravity of each disc's image, minus the projection of the disc's centre [px], (n, 2).

        Perspective and lens distortion cause this difference.
        points_m: centres of discs on the plane [m], (n, 2); radius_m: radius of each disc, (n,), or of all discs [m]
        """
        p = np.asarray(points_m, dtype=float).reshape(-1, 2)
        radii = np.broadcast_to(np.asarray(radius_m, dtype=float), len(p))
        seen, J = self._seen((p[:, None] + radii[:, None, None] * DISC).reshape(-1, 2))
        # image area divided by plane area
        weights = DISC_WEIGHTS * np.abs(np.linalg.det(J)).reshape(len(p), -1)
        places = seen.reshape(len(p), -1, 2)
        middles = (weights[:, :, None] * places).sum(axis=1) / weights.sum(axis=1, keepdims=True)
        return np.asarray(middles - places[:, 0], dtype=np.float64)

    @property
    def view_m(self) -> Floats | None:
        """Points of the plane at the picture's corners, in order [m], (4, 2); None if one is beyond the horizon."""
        right, down = (size - 1.0 for size in self.size_px)
        try:
            return self.to_plane([[0.0, 0.0], [right, 0.0], [right, down], [0.0, down]])
        except ValueError:
            return None

    @property
    def pose(self) -> Pose:
        """Pose from plane axes to camera axes. The plane is z = 0. Raises ValueError for a camera without a lens."""
        if self.lens is None:
            raise ValueError(f"camera {self.name}: expected a lens, found none")
        # H = s K [r1 r2 t]: columns of a rotation have length 1
        B = np.linalg.solve(self.lens.matrix, self.plane_to_px)
        B = B / np.sqrt(np.linalg.norm(B[:, 0]) * np.linalg.norm(B[:, 1]))
        return Pose(np.column_stack([B[:, 0], B[:, 1], np.cross(B[:, 0], B[:, 1])]), B[:, 2])

    def calibration_error(self, points_m: ArrayLike) -> Floats:
        """Shift of plane points due to each calibration error [m], (n, 2, n_calibration). points_m: [m], (n, 2)."""
        p = np.asarray(points_m, dtype=float).reshape(-1, 2)
        by_lens = self._lens_error(p)
        if not self.scale_sd:
            return by_lens
        width, height = self.size_px
        middle = self.to_plane([[(width - 1) / 2.0, (height - 1) / 2.0]])
        return np.concatenate([by_lens, self.scale_sd * (p - middle)[:, :, None]], axis=2)

    @property
    def n_calibration(self) -> int:
        """Number of calibration errors: the rows of `calibration`, and one more if `scale_sd` is stated."""
        return len(self.calibration) + bool(self.scale_sd)

    def _lens_error(self, p: Floats) -> Floats:
        """The part of `calibration_error` from lens and pose; p: points [m], (n, 2)."""
        if self.lens is None or not len(self.calibration):
            return np.zeros((len(p), 2, 0))
        by_px = by_calibration(self.lens, self.pose, np.column_stack([p, np.zeros(len(p))]))
        to_plane = self._seen_from(self.project(p))[1]
        return np.asarray(to_plane @ by_px @ self.calibration.T, dtype=np.float64)

    def _seen(self, points_m: ArrayLike) -> tuple[Floats, Floats]:
        """Picture positions [px], (n, 2), and their derivatives with respect to points_m [px/m], (n, 2, 2)."""
        ideal, J = self._mapped(self.plane_to_px, points_m)
        if self.lens is None:
            return ideal, J
        seen, bent = self.lens.distorted(ideal)
        return seen, bent @ J

    def _seen_from(self, points_px: ArrayLike) -> tuple[Floats, Floats]:
        """Points on the plane, (n, 2), and their derivatives with respect to points_px, (n, 2, 2)."""
        if self.lens is None:
            return self._mapped(self.px_to_plane, points_px)
        ideal = self.lens.ideal(np.asarray(points_px, dtype=float).reshape(-1, 2))
        points, J = self._mapped(self.px_to_plane, ideal)
        return points, J @ np.linalg.inv(self.lens.distorted(ideal)[1])

    def _mapped(self, homography: Floats, points: ArrayLike) -> tuple[Floats, Floats]:
        """Map points by a homography. Returns the results, (n, 2), and the map's Jacobians, (n, 2, 2)."""
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
    # Metres and pixels differ by factors of 1000. So columns and rows are scaled before the test of the rank.
    columns = np.linalg.norm(homography, axis=0)
    rows = np.linalg.norm(homography / np.where(columns > 0, columns, 1.0), axis=1)
    scaled = homography / np.where(columns > 0, columns, 1.0) / np.where(rows > 0, rows, 1.0)[:, None]
    if np.linalg.cond(scaled) > 1e12:
        raise ValueError(f"camera {name} plane_to_px: expected an invertible matrix, found {homography.tolist()}")
    return np.asarray(np.linalg.inv(homography), dtype=np.float64)


def fronto_parallel_camera(
    name: str,
    size_px: tuple[int, int],
    mm_per_px: tuple[float, float],
    centre_m: tuple[float, float] = (0.0, 0.0),
    *,
    calibration_sd_px: float = 0.0,
) -> PlaneCamera:
    """A camera whose optical axis is perpendicular to the plane.

    mm_per_px: width and height of a pixel on the plane [mm]; centre_m: point of the plane at mid-picture [m]
    """
    if not min(mm_per_px) > 0:
        raise ValueError(f"camera {name} mm_per_px: expected more than 0, found {mm_per_px}")
    across, down = 1e3 / mm_per_px[0], 1e3 / mm_per_px[1]
    u0, v0 = (size_px[0] - 1) / 2.0, (size_px[1] - 1) / 2.0
    # u = u0 + (x - x0) across, v = v0 - (y - y0) down
    homography = np.array(
        [[across, 0.0, u0 - across * centre_m[0]], [0.0, -down, v0 + down * centre_m[1]], [0.0, 0.0, 1.0]]
    )
    return PlaneCamera(name, size_px, homography, calibration_sd_px)


def posed_camera(
    name: str, size_px: tuple[int, int], lens: Lens, pose: Pose, *, calibration: ArrayLike = ()
) -> PlaneCamera:
    """A camera with this lens and pose. It looks at the plane z = 0 of the world.

    calibration: errors of lens and pose, (n, 15), as in `Calibration.uncertainty`
    Raises ValueError if mid-picture does not show the plane.
    """
    homography = lens.matrix @ np.column_stack([pose.rotation[:, 0], pose.rotation[:, 1], pose.translation_m])
    camera = PlaneCamera(name, size_px, homography, lens=lens, calibration=np.reshape(calibration, (-1, 15)))
    if camera.plane_to_px[2] @ homography[2] < 0.0:  # `PlaneCamera` has changed the sign
        raise ValueError(f"camera {name} pose: expected the plane before the camera, found it behind")
    return camera
