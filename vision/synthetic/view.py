"""Projection of a synthetic camera: a lens with distortion, a pose, and the exact image of a disc on the plane.

Image axes: u right, v down, the centre of the first pixel is (0, 0). Plane axes: x and y, in metres. Camera axes:
x right, y down, z forward, as in OpenCV.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.arrays import Floats

Singles = NDArray[np.float32]
Box = tuple[int, int, int, int]
"""Box of pixels: left, top, right + 1, bottom + 1 [px]; it may extend outside the picture."""

SAMPLES_PER_PIXEL = 8
"""Number of sub-samples of a pixel along each axis. A disc may cover part of a sub-sample."""
MOVING_SAMPLES_PER_PIXEL = 4
"""Number of sub-samples of a pixel along each axis for a moving disc. Few suffice, because the motion averages them."""
NODES = 9
"""Number of Chebyshev nodes along each axis of a box. In a box of 100 px, interpolation causes an error of 1e-6 px."""


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticView:
    """A lens in front of a plane.

    size_px: width and height of the picture [px]
    matrix: focal lengths and principal point [px], shape (3, 3)
    rotation: rotation from plane axes to camera axes, shape (3, 3)
    translation_m: origin of the plane in camera axes [m], shape (3,)
    distortion: k1, k2, p1, p2, k3 as in OpenCV

    Raises ValueError that names the invalid field.
    """

    size_px: tuple[int, int]
    matrix: Floats
    rotation: Floats
    translation_m: Floats
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if len(self.size_px) != 2 or min(self.size_px) < 2:
            raise ValueError(f"view size_px: expected width and height of at least 2, found {self.size_px}")
        for key, shape in (("matrix", (3, 3)), ("rotation", (3, 3)), ("translation_m", (3,))):
            value = np.array(getattr(self, key), dtype=np.float64)
            if value.shape != shape or not np.isfinite(value).all():
                raise ValueError(f"view {key}: expected finite numbers of shape {shape}, found {value.tolist()}")
            value.setflags(write=False)
            object.__setattr__(self, key, value)
        if not min(self.matrix[0, 0], self.matrix[1, 1]) > 0:
            raise ValueError(f"view matrix: expected focal lengths of more than 0, found {self.matrix.tolist()}")
        R = self.rotation
        if np.abs(R @ R.T - np.eye(3)).max() > 1e-9 or np.linalg.det(R) < 0:
            raise ValueError(f"view rotation: expected a rotation, found {R.tolist()}")
        if len(self.distortion) != 5 or not np.isfinite(self.distortion).all():
            raise ValueError(f"view distortion: expected five finite numbers, found {self.distortion}")
        if abs(R[:, 2] @ self.translation_m) < 1e-9:
            raise ValueError("view translation_m: expected the lens off the plane, found it in the plane")

    def project(self, points_m: ArrayLike) -> Floats:
        """Map plane points [m], (n, 2), to the picture [px], (n, 2). Raises ValueError for points behind the lens."""
        p = np.asarray(points_m, dtype=float).reshape(-1, 2)
        before = p @ self.rotation[:, :2].T + self.translation_m
        if not (before[:, 2] > 0).all():
            raise ValueError(f"view: expected points before the lens, found {p[~(before[:, 2] > 0)][0].tolist()}")
        seen, _ = cv2.projectPoints(before, np.zeros(3), np.zeros(3), self.matrix, np.array(self.distortion))
        return np.asarray(seen, dtype=np.float64).reshape(-1, 2)

    def rays(self, points_px: ArrayLike) -> Floats:
        """Slopes x/z and y/z, (n, 2), of the rays through positions in the picture [px], (n, 2)."""
        p = np.asarray(points_px, dtype=np.float64).reshape(-1, 1, 2)
        stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 60, 1e-10)
        rays = cv2.undistortPoints(p, self.matrix, np.array(self.distortion), criteria=stop)
        return np.asarray(rays, dtype=np.float64).reshape(-1, 2)

    def to_plane(self, points_px: ArrayLike) -> Floats:
        """Map pixels [px], (n, 2), to the plane [m], (n, 2). Raises ValueError for pixels past the horizon."""
        rays = self.rays(points_px)
        directions = np.column_stack([rays, np.ones(len(rays))])
        normal = self.rotation[:, 2]
        towards = directions @ normal
        depth = (normal @ self.translation_m) / np.where(towards == 0, np.nan, towards)
        if not (depth > 0).all():
            raise ValueError("view: expected places before the horizon, found one beyond")
        return np.asarray((depth[:, None] * directions - self.translation_m) @ self.rotation[:, :2])

    def m_per_px(self, center_m: ArrayLike) -> float:
        """Square root of a pixel's area on the plane [m]. center_m: position of the pixel on the plane [m], (2,)."""
        place = self.project(center_m)[0]
        corners = self.to_plane(place + 0.5 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]))
        across, down = corners[0] - corners[1], corners[2] - corners[3]
        return float(np.sqrt(abs(across[0] * down[1] - across[1] * down[0])))


def tilted_view(
    size_px: tuple[int, int],
    focal_px: float,
    mm_per_px: float,
    *,
    tilt_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0),
) -> SyntheticView:
    """A view with the plane's origin at mid-picture. Without tilt, the plane's x axis points right and y up.

    focal_px: focal length [px]; mm_per_px: scale at mid-picture [mm/px]
    tilt_deg: rotations of the plane about u, v and depth [degrees]; distortion: as in `SyntheticView`
    """
    if not min(focal_px, mm_per_px) > 0:
        raise ValueError(f"view: expected focal_px and mm_per_px of more than 0, found {focal_px} and {mm_per_px}")
    matrix = np.array(
        [[focal_px, 0.0, (size_px[0] - 1) / 2.0], [0.0, focal_px, (size_px[1] - 1) / 2.0], [0.0, 0.0, 1.0]]
    )
    R = np.diag([1.0, -1.0, -1.0])
    for axis, angle in zip(np.eye(3), np.deg2rad(tilt_deg), strict=True):
        R = np.asarray(cv2.Rodrigues(axis * angle)[0], dtype=np.float64) @ R
    distance = 1e-3 * mm_per_px * focal_px
    return SyntheticView(size_px, matrix, R, np.array([0.0, 0.0, distance]), distortion)


def disc_box(view: SyntheticView, path_m: Floats, radius_m: float) -> Box:
    """Box of the pixels that a disc may touch while its centre moves along a path [m], (n_moments, 2)."""
    angle = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
    rim = 1.02 * radius_m * np.column_stack([np.cos(angle), np.sin(angle)])  # margin for the rim between the 32 points
    seen = view.project((path_m[:, None] + rim).reshape(-1, 2))
    low, high = np.floor(seen.min(axis=0)).astype(int) - 1, np.ceil(seen.max(axis=0)).astype(int) + 2
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def disc_coverage(view: SyntheticView, box: Box, path_m: Floats, radius_m: float) -> Floats:
    """For each pixel in a box, the share that a disc covers, averaged over the moments of the disc's path.

    path_m: the disc's centre at evenly spaced moments of the exposure [m], shape (n_moments, 2)
    Returns shape (bottom - top, right - left), 0 to 1. For a radius of at least 2 px, the area is accurate to 1e-3.
    """
    n_samples = SAMPLES_PER_PIXEL if len(path_m) == 1 else MOVING_SAMPLES_PER_PIXEL
    middle = path_m.mean(axis=0)
    x, y = _plane_samples(view, box, middle, n_samples)
    step = view.m_per_px(middle) / n_samples
    total = np.zeros_like(x)
    for dx, dy in (path_m - middle).astype(np.float32):
        total += np.clip((radius_m / step + 0.5) - np.sqrt((x - dx) ** 2 + (y - dy) ** 2) / step, 0.0, 1.0)
    height, width = box[3] - box[1], box[2] - box[0]
    by_pixel = total.reshape(height, n_samples, width, n_samples).mean(axis=(1, 3), dtype=np.float64)
    return np.asarray(by_pixel / len(path_m), dtype=np.float64)


def _plane_samples(view: SyntheticView, box: Box, origin_m: Floats, n_samples: int) -> tuple[Singles, Singles]:
    """Positions of a box's sub-samples on the plane: x and y relative to origin_m [m], each (n_rows, n_columns).

    To save time, rays are traced only at Chebyshev nodes, then interpolated.
    """
    (u, along_u), (v, along_v) = (_interpolation(box[k], box[k + 2], n_samples) for k in (0, 1))
    grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    x, y = (view.to_plane(grid) - origin_m).T.reshape(2, NODES, NODES)
    return (along_v @ x @ along_u.T).astype(np.float32), (along_v @ y @ along_u.T).astype(np.float32)


def _interpolation(low: int, high: int, n_samples: int) -> tuple[Floats, Floats]:
    """Chebyshev nodes from low to high [px], and the matrix from values at the nodes to n_samples values per pixel."""
    nodes, inverse = _nodes()
    n = (high - low) * n_samples
    at = 2.0 * (np.arange(n) + 0.5) / n - 1.0
    places = (low + high - 1) / 2.0 + nodes * (high - low) / 2.0
    return places, np.polynomial.chebyshev.chebvander(at, NODES - 1) @ inverse


@lru_cache(maxsize=1)
def _nodes() -> tuple[Floats, Floats]:
    """Chebyshev nodes from -1 to 1, and the matrix from values at the nodes to Chebyshev coefficients."""
    nodes = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
    return nodes, np.asarray(np.linalg.inv(np.polynomial.chebyshev.chebvander(nodes, NODES - 1)))
