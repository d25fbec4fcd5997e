"""Homographies against the formula written out, covariances against sampling and against finite differences."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vision.cameras.test_space_camera import LENS
from vision import Lens, PlaneCamera, Pose, fronto_parallel_camera, posed_camera

TILTED = np.array([[900.0, 40.0, 310.0], [-30.0, -860.0, 250.0], [0.15, -0.25, 1.0]])
"""A camera that looks at the plane from the side: metres to pixels."""


def tilted() -> PlaneCamera:
    return PlaneCamera("side", (640, 480), TILTED)


def test_a_square_camera_has_its_centre_scale_and_axes() -> None:
    camera = fronto_parallel_camera("front", (640, 480), (4.24, 4.56), (0.1, 0.2))
    # The middle of 640 x 480 pixels, the first of which is centred on (0, 0), is (319.5, 239.5).
    np.testing.assert_allclose(camera.project([[0.1, 0.2]]), [[319.5, 239.5]], atol=1e-9)
    # 42.4 mm right is 10 px right, 45.6 mm up is 10 px up: v falls.
    np.testing.assert_allclose(camera.project([[0.1424, 0.2456]]), [[329.5, 229.5]], atol=1e-9)
    np.testing.assert_allclose(camera.mm_per_px((0.3, -0.1)), [4.24, 4.56], rtol=1e-12)


@pytest.mark.parametrize("bent", [False, True])
def test_a_moved_camera_sees_points_where_it_saw_moved_ones(bent: bool) -> None:
    lens = Lens(np.array([[800.0, 0.0, 320.0], [0.0, 800.0, 240.0], [0.0, 0.0, 1.0]]), np.array([-0.2, 0.1, 0, 0, 0]))
    pose = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 1.0]))
    camera = posed_camera("bent", (640, 480), lens, pose) if bent else tilted()
    turn = np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    points, shift = np.array([[0.1, 0.05], [-0.1, 0.08]]), np.array([0.01, -0.02])
    moved = camera.moved(turn, shift)
    np.testing.assert_allclose(moved.project(points), camera.project(points @ turn.T + shift), atol=1e-9)
    np.testing.assert_allclose(moved.to_plane(moved.project(points)), points, atol=1e-6)


def test_projection_is_the_homography() -> None:
    x, y = 0.12, -0.07
    w = 0.15 * x - 0.25 * y + 1.0
    expected = [(900.0 * x + 40.0 * y + 310.0) / w, (-30.0 * x - 860.0 * y + 250.0) / w]
    np.testing.assert_allclose(tilted().project([[x, y]])[0], expected, rtol=1e-13)


def test_the_view_is_what_the_corners_of_the_picture_see() -> None:
    corners = [[0.0, 0.0], [639.0, 0.0], [639.0, 479.0], [0.0, 479.0]]
    np.testing.assert_allclose(tilted().project(tilted().view_m), corners, atol=1e-8)
    flat = fronto_parallel_camera("front", (640, 480), (1.0, 2.0), (0.1, 0.2)).view_m
    np.testing.assert_allclose(flat, [[-0.2195, 0.679], [0.4195, 0.679], [0.4195, -0.279], [-0.2195, -0.279]])


def test_a_picture_with_the_horizon_has_no_view() -> None:
    # the plane's horizon is the line v = 100
    raised = PlaneCamera("low", (640, 480), np.array([[900.0, 0.0, 320.0], [0.0, 100.0, 240.0], [0.0, 1.0, 1.0]]))
    assert raised.view_m is None


@given(st.floats(0.0, 639.0), st.floats(0.0, 479.0))
def test_there_and_back(u: float, v: float) -> None:
    camera = tilted()
    np.testing.assert_allclose(camera.project(camera.to_plane([[u, v]])), [[u, v]], atol=1e-8)


def test_the_pixel_of_a_tilted_camera_changes_over_the_plane() -> None:
    camera = tilted()
    h = 1e-4
    u, v = camera.project([[0.2, 0.1]])[0]
    across = 1e3 * np.linalg.norm(camera.to_plane([[u + h, v]]) - camera.to_plane([[u - h, v]])) / (2 * h)
    down = 1e3 * np.linalg.norm(camera.to_plane([[u, v + h]]) - camera.to_plane([[u, v - h]])) / (2 * h)
    np.testing.assert_allclose(camera.mm_per_px((0.2, 0.1)), [across, down], rtol=1e-6)


def test_no_points_are_no_error() -> None:
    assert tilted().project(np.empty((0, 2))).shape == (0, 2)
    assert tilted().cov_to_plane(np.empty((0, 2)), np.empty((0, 2, 2))).shape == (0, 2, 2)


def test_points_beyond_the_horizon_are_refused() -> None:
    with pytest.raises(ValueError, match=r"camera side: expected points before the horizon, found \[0.0, 5.0\]"):
        tilted().project([[0.1, 0.1], [0.0, 5.0]])


@pytest.mark.parametrize(
    ("size_px", "plane_to_px", "sd", "message"),
    [
        ((0, 480), TILTED, 0.0, "size_px: expected width and height of at least 1"),
        ((640, 480), TILTED[:2], 0.0, r"plane_to_px: expected shape \(3, 3\), found \(2, 3\)"),
        ((640, 480), TILTED * np.nan, 0.0, "plane_to_px: expected finite numbers"),
        ((640, 480), TILTED[[0, 0, 2]], 0.0, "plane_to_px: expected an invertible matrix"),
        ((640, 480), np.zeros((3, 3)), 0.0, "plane_to_px: expected an invertible matrix"),
        ((640, 480), TILTED, -0.1, "calibration_sd_px: expected 0 or more, found -0.1"),
    ],
)
def test_bad_cameras_are_refused(size_px: tuple[int, int], plane_to_px: np.ndarray, sd: float, message: str) -> None:
    with pytest.raises(ValueError, match=f"camera side {message}"):
        PlaneCamera("side", size_px, plane_to_px, sd)


def test_a_plane_behind_a_posed_camera_is_refused() -> None:
    for translation_m, turn_rad in (([0.0, 0.1, -0.6], 0.0), ([0.0, -0.3, 0.6], 1.7)):
        rotation = cv2.Rodrigues(np.array([turn_rad, 0.0, 0.0]))[0] @ np.diag([1.0, -1.0, -1.0])
        with pytest.raises(ValueError, match="camera a pose: expected the plane before the camera, found it behind"):
            posed_camera("a", (640, 480), LENS, Pose(rotation, np.array(translation_m)))


POSE = Pose(cv2.Rodrigues(np.array([0.4, -0.3, 0.1]))[0] @ np.diag([1.0, -1.0, -1.0]), np.array([0.02, -0.03, 0.8]))


def on_plane(n: int = 20) -> np.ndarray:
    return np.random.default_rng(1).uniform(-0.12, 0.12, (n, 2))


def test_a_camera_with_a_lens_sees_what_opencv_projects() -> None:
    camera = posed_camera("a", (640, 480), LENS, POSE)
    points = on_plane()
    turn = cv2.Rodrigues(POSE.rotation)[0]
    space = np.column_stack([points, np.zeros(len(points))])
    expected, _ = cv2.projectPoints(space, turn, POSE.translation_m, LENS.matrix, LENS.distortion)
    np.testing.assert_allclose(camera.project(points), expected.reshape(-1, 2), atol=1e-9)
    np.testing.assert_allclose(camera.to_plane(camera.project(points)), points, atol=1e-12)
    np.testing.assert_allclose(camera.pose.rotation, POSE.rotation, atol=1e-12)
    np.testing.assert_allclose(camera.pose.translation_m, POSE.translation_m, atol=1e-12)


@pytest.mark.parametrize("camera", [tilted(), posed_camera("a", (640, 480), LENS, POSE)], ids=["tilted", "lens"])
def test_covariances_go_through_a_camera_by_its_slope_and_back(camera: PlaneCamera) -> None:
    points, step, cov = on_plane(), 1e-6, np.array([[0.4, 0.1], [0.1, 0.9]])
    covs = np.tile(cov, (len(points), 1, 1))
    J = np.stack([(camera.project(points + d) - camera.project(points - d)) / (2 * step) for d in step * np.eye(2)], -1)
    there = camera.cov_to_px(points, covs)
    np.testing.assert_allclose(there, J @ cov @ J.transpose(0, 2, 1), rtol=1e-6)
    np.testing.assert_allclose(camera.cov_to_plane(camera.project(points), there), covs, atol=1e-9)
    np.testing.assert_allclose(camera.disc_shape(points[0], 0.01), 0.01 * J[0], rtol=1e-6)


@pytest.mark.parametrize("turn_deg", [0.0, 30.0, 60.0])
def test_a_ball_is_a_circle_however_its_plane_is_turned(turn_deg: float) -> None:
    """Mid-picture, by the cone that touches a ball: its tangent is r / sqrt(Z² - r²). A disc is narrower."""
    focal_px, away_m, radius_m, turn = 800.0, 1.5, 0.02, np.radians(turn_deg)
    lens = np.array([[focal_px, 0.0, 319.5], [0.0, focal_px, 239.5], [0.0, 0.0, 1.0]])
    onto = np.array([[np.cos(turn), 0.0, 0.0], [0.0, -1.0, 0.0], [np.sin(turn), 0.0, away_m]])
    camera = PlaneCamera("front", (640, 480), lens @ onto)
    radius_px = focal_px * radius_m / np.sqrt(away_m**2 - radius_m**2)
    shape = camera.ball_shape((0.0, 0.0), radius_m)
    np.testing.assert_allclose(shape, radius_px * np.eye(2), rtol=2e-4, atol=1e-12)
    disc = camera.disc_shape((0.0, 0.0), radius_m)
    np.testing.assert_allclose(disc, shape @ np.diag([np.cos(turn), -1.0]), rtol=1e-9, atol=1e-9)


def test_a_discs_middle_is_seen_off_the_middle_of_its_picture() -> None:
    bent, straight, radius = posed_camera("a", (640, 480), LENS, POSE), PlaneCamera("b", (640, 480), TILTED), 0.02
    turns, rings = 2.0 * np.pi * np.arange(64) / 64, np.sqrt((np.arange(50) + 0.5) / 50)  # of equal areas
    disc = radius * np.stack([np.outer(rings, f(turns)).ravel() for f in (np.cos, np.sin)], axis=-1)
    for point in on_plane(3):
        seen = bent.project(point + disc)
        # pixels of equal size: each place of the plane counts by the area that its picture has
        J = np.stack([bent.project(point + disc + d) - bent.project(point + disc - d) for d in 1e-6 * np.eye(2)], -1)
        weights = np.abs(np.linalg.det(J))
        expected = (weights[:, None] * seen).sum(axis=0) / weights.sum() - bent.project(point)[0]
        assert np.hypot(*expected) > 0.05
        np.testing.assert_allclose(bent.disc_shift(point, radius)[0], expected, atol=3e-4)
    # Without a lens the picture is an ellipse: its centre from the dual of the circle's conic, H C* H'
    (x, y), H = (0.05, -0.03), straight.plane_to_px
    dual = np.array([[x * x - radius**2, x * y, x], [x * y, y * y - radius**2, y], [x, y, 1.0]])
    image = H @ dual @ H.T
    middle = image[:2, 2] / image[2, 2]
    np.testing.assert_allclose(
        straight.disc_shift((x, y), radius)[0], middle - straight.project((x, y))[0], rtol=1e-3, atol=1e-6
    )


def test_what_a_calibration_is_off_by_moves_all_points_together() -> None:
    directions = np.random.default_rng(2).normal(0.0, 1e-4, (4, 15))
    directions[:, 12:] *= 0.1
    camera, points = posed_camera("a", (640, 480), LENS, POSE, calibration=directions), on_plane()
    moved = camera.calibration_error(points)
    assert moved.shape == (20, 2, 4)
    for k, direction in enumerate(directions):
        other = posed_camera("b", (640, 480), LENS.moved(direction[:9]), POSE.moved(direction[9:]))
        expected = camera.to_plane(other.project(points)) - points
        np.testing.assert_allclose(moved[:, :, k], expected, atol=2e-3 * np.abs(expected).max())
    assert PlaneCamera("c", (640, 480), TILTED).calibration_error(points).shape == (20, 2, 0)
    with pytest.raises(ValueError, match="camera c calibration: expected a lens beside it, found none"):
        PlaneCamera("c", (640, 480), TILTED, calibration=directions)


def test_a_scale_of_unknown_error_moves_points_away_from_mid_picture():
    camera = replace(fronto_parallel_camera("front", (641, 481), (1.0, 1.0), (0.1, 0.2)), scale_sd=0.02)
    assert camera.n_calibration == 1
    np.testing.assert_allclose(
        camera.calibration_error([[0.2, 0.2], [0.1, 0.0]]), [[[2e-3], [0.0]], [[0.0], [-4e-3]]], atol=1e-12
    )
    with pytest.raises(ValueError, match="scale_sd: expected 0 or more"):
        replace(camera, scale_sd=-0.1)
