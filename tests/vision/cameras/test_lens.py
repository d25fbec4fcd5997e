"""Lenses against OpenCV's own projection, and back."""

import cv2
import numpy as np
import pytest

from vision import Lens

LENS = Lens(np.array([[800.0, 0, 320], [0, 790, 240], [0, 0, 1]]), np.array([-0.3, 0.1, 0.001, -0.002, 0.02]))


def ideal(n: int = 50) -> np.ndarray:
    return np.random.default_rng(0).uniform((0.0, 0.0), (640.0, 480.0), (n, 2))


def test_rays_are_bent_as_opencv_bends_them() -> None:
    places = ideal()
    rays = np.column_stack([(places - LENS.matrix[:2, 2]) / LENS.matrix[[0, 1], [0, 1]], np.ones(len(places))])
    expected, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), LENS.matrix, LENS.distortion)
    np.testing.assert_allclose(LENS.distorted(places)[0], expected.reshape(-1, 2), atol=1e-9)


def test_the_jacobian_is_the_slope() -> None:
    places, step = ideal(), 1e-4
    for k in range(2):
        ahead = np.zeros(2)
        ahead[k] = step
        slope = (LENS.distorted(places + ahead)[0] - LENS.distorted(places - ahead)[0]) / (2.0 * step)
        np.testing.assert_allclose(LENS.distorted(places)[1][:, :, k], slope, atol=1e-6)


def test_there_and_back() -> None:
    places = ideal()
    np.testing.assert_allclose(LENS.ideal(LENS.distorted(places)[0]), places, atol=1e-8)


def test_a_place_that_no_ray_reaches_is_an_error() -> None:
    with pytest.raises(ValueError, match="lens: expected places that its distortion reaches, found one beyond"):
        Lens(LENS.matrix, np.array([-0.3, 0.0, 0.0, 0.0, 0.0])).ideal(np.array([[320.0, 2000.0]]))
