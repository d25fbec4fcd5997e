"""Cameras in space against OpenCV's projection and finite differences; rays, view, outlines."""

import cv2
import numpy as np
import pytest

from vision import Lens, Pose, SpaceCamera

LENS = Lens(np.array([[800.0, 0, 320], [0, 790, 240], [0, 0, 1]]), np.array([-0.3, 0.1, 0.001, -0.002, 0.02]))
RATIO = [*LENS.distortion, 0.05, -0.02, 0.01]
LENSES = [LENS, Lens(LENS.matrix, np.array(RATIO)), Lens(LENS.matrix, np.array([*RATIO, 0.004, -0.002, 0.003, 0.001]))]
each_lens = pytest.mark.parametrize("lens", LENSES, ids=lambda lens: f"{len(lens.distortion)} coefficients")


def camera_at(place_m: np.ndarray, toward_m: np.ndarray, lens: Lens = LENS, **keys: object) -> SpaceCamera:
    """A camera at a place that looks toward a point, the world's y up in its picture."""
    forward = (toward_m - place_m) / np.linalg.norm(toward_m - place_m)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    return SpaceCamera("left", (640, 480), lens, Pose(R, -R @ place_m), **keys)  # type: ignore[arg-type]


CAMERA = camera_at(np.array([-0.2, 0.1, 0.5]), np.array([0.01, 0.0, 0.02]))
POINTS = np.random.default_rng(0).uniform(-0.06, 0.06, (40, 3))


def by_opencv(camera: SpaceCamera, points: np.ndarray) -> np.ndarray:
    turn, pose = cv2.Rodrigues(camera.pose.rotation)[0], camera.pose
    places = cv2.projectPoints(points, turn, pose.translation_m, camera.lens.matrix, camera.lens.distortion)[0]
    return np.asarray(places).reshape(-1, 2)


@each_lens
def test_points_are_where_opencv_projects_them(lens: Lens) -> None:
    camera = camera_at(np.array([-0.2, 0.1, 0.5]), np.zeros(3), lens)
    np.testing.assert_allclose(camera.project(POINTS), by_opencv(camera, POINTS), atol=1e-8)
    assert camera.in_view(POINTS).all()


@each_lens
def test_the_derivative_is_the_slope(lens: Lens) -> None:
    camera, h = camera_at(np.array([-0.2, 0.1, 0.5]), np.zeros(3), lens), 1e-6
    J = camera.seen(POINTS)[1]
    for k in range(3):
        step = h * np.eye(3)[k]
        slope = (camera.project(POINTS + step) - camera.project(POINTS - step)) / (2.0 * h)
        np.testing.assert_allclose(J[:, :, k], slope, rtol=1e-6, atol=1e-3)


@each_lens
def test_the_ray_of_a_point_leads_through_it(lens: Lens) -> None:
    camera = camera_at(np.array([-0.2, 0.1, 0.5]), np.zeros(3), lens)
    origin, ways = camera.ray(camera.project(POINTS))
    np.testing.assert_allclose(origin, [-0.2, 0.1, 0.5], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), 1.0)
    np.testing.assert_allclose(ways * np.linalg.norm(POINTS - origin, axis=1)[:, None] + origin, POINTS, atol=1e-10)


@each_lens
def test_a_step_of_a_lens_adds_to_the_first_nine(lens: Lens) -> None:
    moved = lens.moved(np.arange(1.0, 10.0))
    np.testing.assert_array_equal((moved.matrix - lens.matrix)[[0, 1, 0, 1], [0, 1, 2, 2]], [1, 2, 3, 4])
    np.testing.assert_allclose((moved.distortion - lens.distortion)[:5], np.arange(5.0, 10.0), rtol=1e-12)
    np.testing.assert_array_equal(moved.distortion[5:], lens.distortion[5:])


def test_a_place_that_no_ray_reaches_is_an_error() -> None:
    with pytest.raises(ValueError, match="lens: expected places that its distortion reaches, found one beyond"):
        Lens(LENS.matrix, np.array([-0.3, 0.0, 0.0, 0.0, 0.0])).ideal(np.array([[320.0, 2000.0]]))


def test_what_is_behind_is_not_in_view() -> None:
    behind = CAMERA.centre_m + CAMERA.pose.rotation.T @ [0.0, 0.0, -0.3]
    assert CAMERA.in_view([[0.0, 0.0, 0.0], behind, CAMERA.centre_m]).tolist() == [True, False, False]
    with pytest.raises(ValueError, match=r"camera left: expected points before it, found \["):
        CAMERA.project([behind])


def test_what_a_lens_folds_into_the_picture_is_not_in_view() -> None:
    folding = camera_at(np.array([0.0, 0.0, 0.5]), np.zeros(3), Lens(LENS.matrix, np.array([-0.4, 0.0, 0.0, 0.0, 0.0])))
    aside = np.array([[0.85, 0.0, 0.0]])
    assert (np.abs(folding.project(aside) - [320.0, 240.0]) < [320.0, 240.0]).all()
    assert not folding.in_view(aside).any()


def test_a_disc_is_an_ellipse_across_its_normal() -> None:
    normal, at, radius = np.array([0.3, -0.2, 0.9]), np.array([0.02, 0.01, 0.03]), 1e-4
    shape = CAMERA.disc_shape(at, normal, radius)
    a = np.cross(normal, [1.0, 0.0, 0.0])
    b = np.cross(normal, a)
    angles = np.linspace(0.0, 2.0 * np.pi, 30)[:, None]
    rim = at + radius * (np.cos(angles) * a / np.linalg.norm(a) + np.sin(angles) * b / np.linalg.norm(b))
    away = (by_opencv(CAMERA, rim) - by_opencv(CAMERA, at[None])) @ np.linalg.inv(shape).T
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 1.0, rtol=2e-3)


def test_a_ball_is_as_wide_as_its_own_disc() -> None:
    at, radius = np.array([0.0, 0.0, 0.02]), 0.003
    axes = np.linalg.svd(CAMERA.ball_shape(at, radius), compute_uv=False)
    away = np.linalg.norm(at - CAMERA.centre_m)
    np.testing.assert_allclose(axes, 800.0 * radius / away, rtol=0.03)


def test_errors_of_the_calibration_move_places_by_their_slope() -> None:
    steps, h = 1e-3 * np.random.default_rng(1).normal(size=(4, 15)), 1e-3
    camera = camera_at(np.array([-0.2, 0.1, 0.5]), np.zeros(3), calibration=steps)
    shifts = camera.moved_by(POINTS, camera.calibration)
    for k, step in enumerate(steps):
        ahead, back = (
            SpaceCamera("left", (640, 480), LENS.moved(s * h * step[:9]), camera.pose.moved(s * h * step[9:]))
            for s in (1.0, -1.0)
        )
        slope = (ahead.project(POINTS) - back.project(POINTS)) / (2.0 * h)
        np.testing.assert_allclose(shifts[:, :, k], slope, rtol=1e-4, atol=1e-4)
    assert CAMERA.moved_by(POINTS, CAMERA.calibration).shape == (40, 2, 0)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"size_px": (0, 480)}, "camera left size_px: expected width and height of at least 1, found"),
        ({"calibration_sd_px": -1.0}, "camera left calibration_sd_px: expected 0 or more, found -1.0"),
        ({"lens": Lens(np.diag([-800.0, 790.0, 1.0]), np.zeros(5))}, "camera left lens: expected a camera matrix"),
        ({"pose": Pose(2.0 * np.eye(3), np.zeros(3))}, "camera left pose: expected a rotation, found"),
        ({"pose": Pose(np.diag([1.0, 1.0, -1.0]), np.zeros(3))}, "camera left pose: expected a rotation, found a refl"),
        ({"pose": Pose(np.full((3, 3), np.nan), np.zeros(3))}, "camera left pose: expected a rotation, found"),
        ({"pose": Pose(np.eye(3), np.full(3, np.inf))}, "camera left pose: expected a translation, found"),
    ],
)
def test_faults_are_named(keys: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SpaceCamera(**{"name": "left", "size_px": (640, 480), "lens": LENS, "pose": CAMERA.pose, **keys})  # type: ignore[arg-type]
