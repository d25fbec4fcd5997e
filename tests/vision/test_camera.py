"""Homographies against the formula written out, covariances against sampling and against finite differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vision import PlaneCamera, squarely

TILTED = np.array([[900.0, 40.0, 310.0], [-30.0, -860.0, 250.0], [0.15, -0.25, 1.0]])
"""A camera that looks at the plane from the side: metres to pixels."""


def tilted() -> PlaneCamera:
    return PlaneCamera("side", (640, 480), TILTED)


def test_a_square_camera_has_its_centre_scale_and_axes() -> None:
    camera = squarely("front", (640, 480), (4.24, 4.56), (0.1, 0.2))
    # The middle of 640 x 480 pixels, the first of which is centred on (0, 0), is (319.5, 239.5).
    np.testing.assert_allclose(camera.project([[0.1, 0.2]]), [[319.5, 239.5]], atol=1e-9)
    # 42.4 mm right is 10 px right, 45.6 mm up is 10 px up: v falls.
    np.testing.assert_allclose(camera.project([[0.1424, 0.2456]]), [[329.5, 229.5]], atol=1e-9)
    np.testing.assert_allclose(camera.mm_per_px((0.3, -0.1)), [4.24, 4.56], rtol=1e-12)


def test_projection_is_the_homography() -> None:
    x, y = 0.12, -0.07
    w = 0.15 * x - 0.25 * y + 1.0
    expected = [(900.0 * x + 40.0 * y + 310.0) / w, (-30.0 * x - 860.0 * y + 250.0) / w]
    np.testing.assert_allclose(tilted().project([[x, y]])[0], expected, rtol=1e-13)


@given(st.floats(0.0, 639.0), st.floats(0.0, 479.0))
def test_there_and_back(u: float, v: float) -> None:
    camera = tilted()
    np.testing.assert_allclose(camera.project(camera.to_plane([[u, v]])), [[u, v]], atol=1e-8)


def test_the_scale_and_sign_of_a_homography_do_not_matter() -> None:
    other = PlaneCamera("side", (640, 480), -3.0 * TILTED)
    np.testing.assert_allclose(other.project([[0.1, 0.1]]), tilted().project([[0.1, 0.1]]), rtol=1e-12)


@pytest.mark.parametrize(("u", "v"), [(10.0, 20.0), (600.0, 400.0)])
def test_covariances_pass_by_the_jacobian(u: float, v: float) -> None:
    camera = tilted()
    cov_px = np.array([[0.4, 0.1], [0.1, 0.9]])
    h = 1e-4  # central differences: error of order h² of the third derivative, below 1e-9 of the value
    J = np.column_stack(
        [
            (camera.to_plane([[u + h, v]]) - camera.to_plane([[u - h, v]]))[0] / (2 * h),
            (camera.to_plane([[u, v + h]]) - camera.to_plane([[u, v - h]]))[0] / (2 * h),
        ]
    )
    on_plane = camera.cov_to_plane([[u, v]], [cov_px])
    np.testing.assert_allclose(on_plane[0], J @ cov_px @ J.T, rtol=1e-6)
    # And back again: the Jacobians are each other's inverses.
    np.testing.assert_allclose(camera.cov_to_px(camera.to_plane([[u, v]]), on_plane)[0], cov_px, rtol=1e-9)


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
