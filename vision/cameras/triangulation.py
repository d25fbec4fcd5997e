"""Triangulation of points from the pictures of several cameras, with covariances.

Any subset of the cameras may see a point. The result minimises the sum of the squared normalised residuals in
the pictures. The iteration starts from the plain triangulation: the point nearest to the rays in space [hartley2004].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.arrays import Floats
from vision.cameras.space_camera import SpaceCamera

STEPS = 8
"""Largest number of Gauss-Newton steps; numerical: from the plain triangulation, three steps usually suffice."""

SETTLED_M = 1e-6
"""Length of a step below which the iteration ends [m]; numerical."""

LEAST_PX = 0.005
"""Largest rms shift of the projections due to all omitted calibration errors [px]; choice: a twentieth of the position
error of a well visible mark. With a tenth, the NEES of points seen by moved cameras was 4.9; expected is 3."""

N_CALIBRATION = 15
"""Number of parameters of a camera's lens and pose."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Positions of points in the picture of one camera.

    which: indices of the m points that the camera sees, each at most once, (m,)
    places_px, covs_px2: positions of these points in the picture [px], (m, 2), and their covariances [px²], (m, 2, 2)
    steps: effect of each independent calibration error on lens and pose, (n_shared, 15), as in `calibration_steps`
    """

    camera: SpaceCamera
    which: Sequence[int]
    places_px: Floats
    covs_px2: Floats
    steps: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Triangulated:
    """Triangulated points in space with their covariances.

    positions: positions [m], (n, 3)
    covs: covariances of the positions, without calibration errors [m²], (n, 3, 3)
    shared: shift of each position due to each calibration error [m], (n, 3, n_shared)
    misfit: for each point, the sum of the squared normalised residuals in all pictures, (n,), minimised over position
        and calibration errors. If n_views > 1, misfit has a chi-square distribution with 2 n_views - 3 degrees of
        freedom.
    n_views: number of cameras that see each point, (n,)
    """

    positions: Floats
    covs: Floats
    shared: Floats
    misfit: Floats
    n_views: NDArray[np.int64]


def nearest_to_rays(origins_m: ArrayLike, directions: ArrayLike) -> Floats:
    """The point with the least sum of squared distances from two or more rays [m], (3,).

    origins_m: a point on each ray [m], (n, 3); directions: unit vectors, (n, 3). Raises ValueError for parallel rays.
    """
    o, d = np.asarray(origins_m, dtype=float), np.asarray(directions, dtype=float)
    across = np.eye(3) - d[:, :, None] * d[:, None, :]
    A = across.sum(axis=0)
    if len(d) < 2 or np.linalg.cond(A) > 1e12:
        raise ValueError(f"rays: expected two or more that are not parallel, found {d.tolist()}")
    return np.asarray(np.linalg.solve(A, np.einsum("nij,nj->i", across, o)), dtype=np.float64)


def plain_triangulation(cameras: Sequence[SpaceCamera], places_px: ArrayLike) -> Floats:
    """Position of a point [m], (3,), by `nearest_to_rays`; places_px: point in each picture [px], (n_cameras, 2)."""
    rays = [camera.ray(place) for camera, place in zip(cameras, np.asarray(places_px), strict=True)]
    return nearest_to_rays([origin for origin, _ in rays], [ways[0] for _, ways in rays])


def triangulated(
    cameras: Sequence[SpaceCamera], places_px: ArrayLike, covs_px2: ArrayLike, steps: Sequence[Floats] | None = None
) -> Triangulated:
    """Triangulate one point that two or more cameras see. Each array in the result has one row.

    places_px, covs_px2: positions of the point in the pictures [px], (n, 2), and their covariances [px²], (n, 2, 2)
    steps: calibration errors of each camera, as in `Seen`; default: `calibration_steps`
    """
    places, covs = np.asarray(places_px, dtype=float), np.asarray(covs_px2, dtype=float)
    by = calibration_steps(cameras) if steps is None else steps
    seen = [Seen(c, [0], places[[k]], covs[[k]], by[k]) for k, c in enumerate(cameras)]
    return triangulate(seen, plain_triangulation(cameras, places)[None])


def triangulate(seen: Sequence[Seen], start_m: Floats, start_sd_m: float = np.inf) -> Triangulated:
    """Triangulate several points by Gauss-Newton steps.

    start_m: initial positions of the points [m], (n, 3). They are also used as measurements of the points.
    start_sd_m: standard deviation of these measurements on each axis [m]. A good value is the size of the body. With
        this value, start_m hardly affects a point that two cameras see. If only one camera sees a point, the point's
        error along the camera's ray is about start_sd_m.

    If a step would move a point behind one of its cameras, the point's misfit is inf.
    Raises ValueError if start_sd_m is infinite and fewer than two cameras see a point.
    """
    n, n_shared = len(start_m), max((one.steps.shape[0] for one in seen), default=0)
    views = np.zeros(n, dtype=np.int64)
    for one in seen:
        views[one.which] += 1
    if np.isinf(start_sd_m) and (views < 2).any():
        raise ValueError("start_sd_m: expected a finite one for points that fewer than two cameras see, found inf")
    weights, x, lost = [np.linalg.inv(one.covs_px2) for one in seen], start_m, np.zeros(n, dtype=bool)
    for _ in range(STEPS):
        information = np.tile(np.eye(3) / start_sd_m**2, (n, 1, 1))
        pull, views_of_it = (start_m - x) / start_sd_m**2, []
        for one, W in zip(seen, weights, strict=True):
            places, J = one.camera.seen(x[one.which])
            away, JW = one.places_px - places, J.transpose(0, 2, 1) @ W
            views_of_it.append((away, JW))
            information[one.which] += JW @ J
            pull[one.which] += (JW @ away[:, :, None])[:, :, 0]
        covs = np.asarray(np.linalg.inv(information), dtype=np.float64)
        step = (covs @ pull[:, :, None])[:, :, 0]
        for one in seen:
            depth = (x + step)[one.which] @ one.camera.pose.rotation[2] + one.camera.pose.translation_m[2]
            lost[np.asarray(one.which)[~(depth > 0.0)]] = True
        x = x + np.where(lost[:, None], 0.0, step)
        if lost.all() or np.abs(step).max(initial=0.0) < SETTLED_M:
            break
    moved, misfit = np.zeros((n, 3, n_shared)), np.where(lost, np.inf, 0.0)
    against, inner = np.zeros((n, n_shared)), np.tile(np.eye(n_shared), (n, 1, 1))
    for one, (away, JW), W in zip(seen, views_of_it, weights, strict=True):
        misfit[one.which] += np.einsum("ni,nij,nj->n", away, W, away)
        if n_shared:
            by = one.camera.moved_by(x[one.which], one.steps)
            by_W = by.transpose(0, 2, 1) @ W
            moved[one.which] += JW @ by
            against[one.which] += (by_W @ away[:, :, None])[:, :, 0]
            inner[one.which] += by_W @ by
    if n_shared:
        # minimum of |z - J x - G c|² + |c|² over position x and calibration c, from the minimum over x alone
        inner -= moved.transpose(0, 2, 1) @ covs @ moved
        misfit -= np.einsum("ni,ni->n", against, np.linalg.solve(inner, against[:, :, None])[:, :, 0])
    return Triangulated(x, 0.5 * (covs + covs.transpose(0, 2, 1)), covs @ moved, misfit, views)


def calibration_steps(cameras: Sequence[SpaceCamera]) -> list[Floats]:
    """Calibration errors of several cameras: an array (n_shared, 15) for each camera, as in `Calibration.uncertainty`.

    There are n_shared independent errors in all. Row i of a camera's array is the effect of error i on this camera. If
    error i does not affect the camera, row i is zero. Several cameras are assumed to share their errors if their fields
    `calibration` have the same number of rows, and if this number exceeds 15.
    """
    sizes = [len(camera.calibration) for camera in cameras]
    first: dict[int, int] = {}
    begins, total = [], 0
    for n in sizes:
        together = n > N_CALIBRATION and n in first
        begins.append(first[n] if together else total)
        if not together:
            first[n] = total
            total += n
    steps = []
    for camera, begin, n in zip(cameras, begins, sizes, strict=True):
        own = np.zeros((total, N_CALIBRATION))
        own[begin : begin + n] = camera.calibration
        steps.append(own)
    return steps


def principal_steps(cameras: Sequence[SpaceCamera], points_m: Floats, least_px: float = LEAST_PX) -> list[Floats]:
    """Principal components of the calibration errors of several cameras.

    The result has one array (n_shared, 15) for each camera, like the result of `calibration_steps`. The components are
    sorted by their effect on the projections of points, and the last components are omitted.
    points_m: the points [m], (n, 3)
    least_px: largest rms shift of the projections that all omitted components cause together [px]
    """
    steps = calibration_steps(cameras)
    if not any(len(own) for own in steps):
        return steps
    effects = [
        camera.moved_by(points_m[seen], own).reshape(-1, len(own))
        for camera, own in zip(cameras, steps, strict=True)
        if (seen := camera.in_view(points_m)).any()
    ]
    if not effects:
        return [own[:0] for own in steps]
    effect = np.concatenate(effects)
    _, sizes, turns = np.linalg.svd(effect, full_matrices=False)
    left_out = np.cumsum(sizes[::-1] ** 2)[::-1]  # effect of each component and all smaller ones
    kept = turns[left_out > least_px**2 * len(effect) / 2.0]
    return [kept @ own for own in steps]
