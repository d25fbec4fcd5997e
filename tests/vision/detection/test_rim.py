"""Centres by the rim, of balls whose colour is nowhere the same, and of marks that blood hides the shape of."""

import cv2
import numpy as np
import pytest

from vision import Disc, Expected, Lighting, MarkHue, Outline, detect_marks, draw_frame
from vision.detection.rim import fit_rim
from vision.detection.rim_search import detect_by_rim


def ball(center: np.ndarray, radius: float, rng: np.random.Generator) -> np.ndarray:
    """A shaded green ball with a white stripe, half lit, before a grey wall, drawn finely and shrunk: (96, 96, 3)."""
    fine = 6
    at = (np.arange(96 * fine) + 0.5) / fine - 0.5
    u, v = np.meshgrid((at - center[0]) / radius, (at - center[1]) / radius)
    depth = np.sqrt(np.maximum(0.0, 1.0 - u**2 - v**2))
    light = np.clip(0.25 + 0.75 * (0.5 * u - 0.6 * v + 0.6 * depth), 0.15, 1.0)[..., None]
    color = np.where((np.abs(u + 0.3 * v) < 0.15)[..., None], (220.0, 220.0, 220.0), (60.0, 190.0, 70.0)) * light
    picture = np.where((u**2 + v**2 < 1.0)[..., None], color, (150.0, 155.0, 160.0))
    small = picture.reshape(96, fine, 96, fine, 3).mean(axis=(1, 3))
    blurred = cv2.GaussianBlur(small, (0, 0), 0.9) + rng.normal(0.0, 2.0, small.shape)
    return np.clip(blurred, 0, 255).astype(np.uint8)


@pytest.mark.slow
def test_a_ball_is_found_by_its_rim_within_its_covariance() -> None:
    rng = np.random.default_rng(1)
    errors, covs, by_color = [], [], []
    for _ in range(10):
        center, radius = rng.uniform(46.0, 50.0, 2), rng.uniform(18.0, 26.0)
        image = ball(center, radius, rng)
        hues = [MarkHue(115.0, 30.0, 0.3, 0.1)]
        outlines = [Outline(radius * np.exp(rng.normal(0.0, 0.03)) * np.eye(2), 0.05, even=False)]
        found = detect_marks(image, hues, min_area_px=200.0, outlines=outlines)[0]
        errors.append(found.center_px - center)
        covs.append(found.cov_px2)
        by_color.append(detect_marks(image, hues, min_area_px=200.0)[0].center_px - center)
    off = np.array(errors)
    assert np.sqrt((off**2).mean()) < 0.25  # measured 0.1
    assert np.sqrt((np.array(by_color) ** 2).mean()) > 1.0  # its colour lies where the light does
    # real balls are less perfect than drawn ones, and the covariance is theirs
    sigma = np.sqrt(np.mean([np.trace(cov) / 2.0 for cov in covs]))
    assert np.sqrt((off**2).mean()) < sigma < 0.6


def test_no_rim_is_found_where_there_is_none() -> None:
    rng = np.random.default_rng(2)
    noise = np.clip(rng.normal(128.0, 1.0, (80, 80, 3)), 0, 255).astype(np.uint8)
    assert fit_rim(noise, np.array([[40.0, 40.0, 1.0]]), Outline(15.0 * np.eye(2))) is None


def beside_blood(rng: np.random.Generator, center: np.ndarray) -> np.ndarray:
    """A bright red mark on the border of a pool of darker red."""
    pool = Disc(np.array([70.0, 72.0]), (30.0, 18.0), 0.0, saturation=0.85, value=0.35)
    return draw_frame((120, 110), [pool, Disc(center, (10.0, 10.0), 0.0)], Lighting(), rng)


def test_a_mark_on_blood_is_found_by_its_rim_about_where_it_is_expected() -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        center = np.array([62.0, 58.0]) + rng.uniform(-1.0, 1.0, 2)
        outline = Outline(10.0 * np.eye(2), 0.05)
        expected = Expected("M1", center + rng.normal(0.0, 1.0, 2), np.eye(2), 0.0, outline)
        found = detect_by_rim(beside_blood(rng, center), expected)
        assert found is not None
        assert np.abs(found.center_px - center).max() < 0.5
        assert found.color_bgr[2] > 120.0


@pytest.mark.parametrize(
    ("sd", "outline"), [(40.0, Outline(10.0 * np.eye(2), 0.05)), (2.0, None)], ids=["anywhere", "of no known looks"]
)
def test_nothing_is_looked_for_anywhere(sd: float, outline: Outline | None) -> None:
    image = beside_blood(np.random.default_rng(4), np.array([62.0, 58.0]))
    assert detect_by_rim(image, Expected("M1", np.array([62.0, 58.0]), sd**2 * np.eye(2), 0.0, outline)) is None
