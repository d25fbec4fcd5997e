"""Lenses against OpenCV's own projection, and back."""

import cv2
import numpy as np
import pytest

from vision import Lens

LENS = Lens(np.array([[800.0, 0, 320], [0, 790, 240], [0, 0, 1]]), np.array([-0.3, 0.1, 0.001, -0.002, 0.02]))


RATIO = [*LENS.distortion, 0.05, -0.02, 0.01]
LENSES = [LENS, Lens(LENS.matrix, np.array(RATIO)), Lens(LENS.matrix, np.array([*RATIO, 0.004, -0.002, 0.003, 0.001]))]
each_lens = pytest.mark.parametrize("lens", LENSES, ids=lambda lens: f"{len(lens.distortion)} coefficients")


def ideal(n: int = 50) -> np.ndarray:
    return np.random.default_rng(0).uniform((0.0, 0.0), (640.0, 480.0), (n, 2))


@each_lens
def test_rays_are_bent_as_opencv_bends_them(lens: Lens) -> None:
    places = ideal()
    rays = np.column_stack([(places - lens.matrix[:2, 2]) / lens.matrix[[0, 1], [0, 1]], np.ones(len(places))])
    expected, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), lens.matrix, lens.distortion)
    np.testing.assert_allclose(lens.distorted(places)[0], expected.reshape(-1, 2), atol=1e-9)


@each_lens
def test_the_jacobian_is_the_slope(lens: Lens) -> None:
    places, step = ideal(), 1e-4
    for k in range(2):
        ahead = np.zeros(2)
        ahead[k] = step
        slope = (lens.distorted(places + ahead)[0] - lens.distorted(places - ahead)[0]) / (2.0 * step)
        np.testing.assert_allclose(lens.distorted(places)[1][:, :, k], slope, atol=1e-6)


@each_lens
def test_there_and_back(lens: Lens) -> None:
    places = ideal()
    np.testing.assert_allclose(lens.ideal(lens.distorted(places)[0]), places, atol=1e-8)


@each_lens
def test_a_step_adds_to_the_first_nine(lens: Lens) -> None:
    moved = lens.moved(np.arange(1.0, 10.0))
    np.testing.assert_array_equal((moved.matrix - lens.matrix)[[0, 1, 0, 1], [0, 1, 2, 2]], [1, 2, 3, 4])
    np.testing.assert_allclose((moved.distortion - lens.distortion)[:5], np.arange(5.0, 10.0), rtol=1e-12)
    np.testing.assert_array_equal(moved.distortion[5:], lens.distortion[5:])


def test_a_place_that_no_ray_reaches_is_an_error() -> None:
    with pytest.raises(ValueError, match="lens: expected places that its distortion reaches, found one beyond"):
        Lens(LENS.matrix, np.array([-0.3, 0.0, 0.0, 0.0, 0.0])).ideal(np.array([[320.0, 2000.0]]))
