"""Points from several cameras: error and covariance by simulation, one camera, calibration, plain triangulation."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.vision.cameras.test_space_camera import POINTS, camera_at
from vision import (
    Seen,
    SpaceCamera,
    calibration_steps,
    nearest_to_rays,
    plain_triangulation,
    principal_steps,
    triangulate,
    triangulated,
)

PLACES = ((-0.25, 0.1, 0.45), (0.25, 0.05, 0.5), (0.0, 0.35, 0.4))
CAMERAS = [camera_at(np.array(place), np.zeros(3)) for place in PLACES]
NONE = np.zeros((0, 15))


def seen_by(cameras: list[SpaceCamera], noise: np.ndarray, sd_px: float) -> list[Seen]:
    """All points by all cameras; noise: standard normal, (n_cameras, n, 2)."""
    covs, all_of_them = np.tile(sd_px**2 * np.eye(2), (len(POINTS), 1, 1)), list(range(len(POINTS)))
    return [
        Seen(camera, all_of_them, camera.project(POINTS) + sd_px * noise[k], covs, NONE)
        for k, camera in enumerate(cameras)
    ]


def test_without_noise_points_are_where_they_are() -> None:
    for point in POINTS[:5]:
        places = [camera.project(point[None])[0] for camera in CAMERAS]
        np.testing.assert_allclose(plain_triangulation(CAMERAS, places), point, atol=1e-9)
        found = triangulated(CAMERAS, places, [np.eye(2)] * 3)
        np.testing.assert_allclose(found.positions[0], point, atol=1e-9)
        assert found.misfit[0] < 1e-9
        assert found.n_views.tolist() == [3]


@pytest.mark.parametrize("n_cameras", [2, 3])
def test_errors_are_as_the_covariance_and_the_misfit_as_chi_square(n_cameras: int) -> None:
    rng, cameras, runs = np.random.default_rng(0), CAMERAS[:n_cameras], 50
    nees, misfits = [], []
    for _ in range(runs):
        seen = seen_by(cameras, rng.normal(size=(n_cameras, len(POINTS), 2)), 0.3)
        found = triangulate(seen, POINTS + rng.normal(0.0, 0.02, POINTS.shape))
        away = found.positions - POINTS
        nees.append(np.einsum("ni,nij,nj->n", away, np.linalg.inv(found.covs), away))
        misfits.append(found.misfit)
    n = runs * len(POINTS)
    for values, dof in ((nees, 3), (misfits, 2 * n_cameras - 3)):
        low, high = chi2.ppf([0.001, 0.999], n * dof)
        assert low < np.sum(values) < high


def test_it_beats_the_plain_triangulation_where_one_camera_is_worse() -> None:
    rng, sds = np.random.default_rng(1), (0.1, 0.1, 2.0)
    errors = []
    for point in np.repeat(POINTS[:20], 5, axis=0):
        places = [c.project(point[None])[0] + sd * rng.normal(size=2) for c, sd in zip(CAMERAS, sds, strict=True)]
        ours = triangulated(CAMERAS, places, [sd**2 * np.eye(2) for sd in sds]).positions[0]
        errors.append([np.linalg.norm(ours - point), np.linalg.norm(plain_triangulation(CAMERAS, places) - point)])
    ours_m, plain_m = np.sqrt(np.mean(np.square(errors), axis=0))
    assert plain_m > 3.0 * ours_m


def test_one_camera_gives_a_place_on_its_ray() -> None:
    camera, sd_px, expected = CAMERAS[0], 0.3, POINTS + np.array([0.004, -0.003, 0.002])
    seen = [Seen(camera, [3], camera.project(POINTS[[3]]), sd_px**2 * np.eye(2)[None], NONE)]
    found = triangulate(seen, expected[[3, 3, 3, 3]], 0.1)
    place, cov = found.positions[3], found.covs[3]
    origin, ways = camera.ray(camera.project(POINTS[[3]]))
    np.testing.assert_allclose(np.cross(place - origin, ways[0]), 0.0, atol=1e-6)
    # along the ray it stays where it was expected, as far as the prior of 100 mm goes
    assert abs((place - expected[3]) @ ways[0]) < 1e-5
    assert np.sqrt(ways[0] @ cov @ ways[0]) == pytest.approx(0.1, rel=1e-3)
    J = camera.seen(place[None])[1][0]
    np.testing.assert_allclose(J @ cov @ J.T, sd_px**2 * np.eye(2), rtol=1e-4, atol=1e-6)
    assert found.n_views.tolist() == [0, 0, 0, 1]


def test_one_camera_alone_needs_a_start() -> None:
    seen = [Seen(CAMERAS[0], [0], CAMERAS[0].project(POINTS[:1]), np.eye(2)[None], NONE)]
    with pytest.raises(ValueError, match="start_sd_m: expected a finite one"):
        triangulate(seen, POINTS[:1])


def calibrated(each) -> list[SpaceCamera]:
    """The cameras with directions of the calibration's error, (n, 15) each."""
    return [replace(camera, calibration=own) for camera, own in zip(CAMERAS, each, strict=False)]


def test_errors_of_the_calibration_move_points_as_they_say() -> None:
    rng, h = np.random.default_rng(2), 0.1
    calibration = 1e-3 * rng.normal(size=(2, 20, 15))
    cameras = calibrated(calibration)
    steps = calibration_steps(cameras)
    covs = np.tile(0.04 * np.eye(2), (2, 1, 1))
    point = POINTS[0]
    places = np.array([camera.project(point[None])[0] for camera in cameras])
    shared = triangulated(cameras, places, covs).shared[0]
    assert shared.shape == (3, 20)
    for k in range(20):
        # what is seen is by true cameras, which are one step away from the calibrated ones
        found = []
        for s in (h, -h):
            seen = []
            for c, own in zip(cameras, steps, strict=True):
                true = SpaceCamera(c.name, c.size_px, c.lens.moved(s * own[k, :9]), c.pose.moved(s * own[k, 9:]))
                seen.append(true.project(point[None])[0])
            found.append(triangulated(cameras, np.array(seen), covs, [NONE, NONE]).positions[0])
        ahead, back = found
        np.testing.assert_allclose(shared[:, k], (ahead - back) / (2.0 * h), rtol=1e-3, atol=1e-7)


def test_the_misfit_allows_for_the_calibration() -> None:
    """Against the textbook: normalised residuals under the whole covariance R + G G', position fitted."""
    rng, cameras = np.random.default_rng(4), CAMERAS[:2]
    steps = [1e-3 * rng.normal(size=(4, 15)) for _ in cameras]
    point = POINTS[0]
    places = np.array([camera.project(point[None])[0] for camera in cameras]) + 0.3 * rng.normal(size=(2, 2))
    J = np.concatenate([camera.seen(point[None])[1][0] for camera in cameras])
    G = np.concatenate([c.moved_by(point[None], own)[0] for c, own in zip(cameras, steps, strict=True)])
    S = np.linalg.inv(0.09 * np.eye(4) + G @ G.T)
    z = (places - [camera.project(point[None])[0] for camera in cameras]).ravel()
    rest = z - J @ np.linalg.solve(J.T @ S @ J, J.T @ S @ z)
    found = triangulated(cameras, places, np.tile(0.09 * np.eye(2), (2, 1, 1)), steps)
    assert found.misfit[0] == pytest.approx(rest @ S @ rest, rel=1e-2)
    assert found.misfit[0] < 0.9 * triangulated(cameras, places, np.tile(0.09 * np.eye(2), (2, 1, 1))).misfit[0]


def test_cameras_share_directions_where_they_were_calibrated_together() -> None:
    def steps_of(*sizes: int) -> list[tuple[int, ...]]:
        cameras = calibrated([np.ones((n, 15)) for n in sizes])
        return [tuple(np.flatnonzero(own.any(axis=1))) for own in calibration_steps(cameras)]

    assert steps_of(30, 30) == [tuple(range(30))] * 2
    assert steps_of(2, 3) == [(0, 1), (2, 3, 4)]
    assert steps_of(15, 15) == [tuple(range(15)), tuple(range(15, 30))]
    assert steps_of(30, 0, 30) == [tuple(range(30)), (), tuple(range(30))]


def test_points_that_cannot_be_before_both_cameras_have_no_fit() -> None:
    # the rays of two cameras that face each other, each away from the other
    cameras = [camera_at(np.array([0.0, 0.0, z]), np.array([0.0, 0.0, 0.0])) for z in (0.5, 0.45)]
    places = [np.array([[100.0, 240.0]]), np.array([[500.0, 240.0]])]
    seen = [Seen(c, [0], p, 0.01 * np.eye(2)[None], NONE) for c, p in zip(cameras, places, strict=True)]
    assert triangulate(seen, np.zeros((1, 3)), 0.2).misfit[0] > 1e3


def test_parallel_rays_have_no_nearest_point() -> None:
    with pytest.raises(ValueError, match="rays: expected two or more that are not parallel"):
        nearest_to_rays([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])


def test_principal_directions_are_the_same_errors() -> None:
    calibration = 1e-4 * np.random.default_rng(3).normal(size=(2, 40, 15)) * ([1e4] * 4 + [10.0] * 5 + [1.0] * 6)
    cameras = calibrated(calibration)
    whole, few = calibration_steps(cameras), principal_steps(cameras, POINTS)
    assert 5 < len(few[0]) == len(few[1]) < 30
    assert principal_steps(cameras, POINTS, 1e3)[0].shape == (0, 15)
    assert principal_steps(CAMERAS, POINTS)[0].shape == (0, 15)

    def cov_px2(steps: list[np.ndarray]) -> np.ndarray:
        effect = np.concatenate(
            [c.moved_by(POINTS, own).reshape(-1, len(own)) for c, own in zip(cameras, steps, strict=True)]
        )
        return np.asarray(effect @ effect.T)

    np.testing.assert_allclose(cov_px2(few), cov_px2(whole), atol=1e-2)
