"""Drawn frames against closed forms: area, centre, blur, noise, colours."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.vision.synthetic.test_camera_frames import moments
from vision import Disc, Lighting, distractors, draw_frame, hue_distance

FLAT = Lighting(slope=0.0, vignetting=0.0, blur_sd_px=0.0, noise_sd=0.0, shot_noise_sd=0.0)
"""No effects: what is left is the disc itself."""


def drawn_share(disc: Disc, lighting: Lighting) -> np.ndarray:
    """The share of each pixel that the disc covers, from the blue channel, good to half a grey level of 180."""
    image = draw_frame((80, 60), [disc], lighting, np.random.default_rng(0))
    blue_of_mark = 255.0 * disc.value * (1.0 - disc.saturation)
    return (lighting.background_bgr[0] - image[:, :, 0]) / (lighting.background_bgr[0] - blue_of_mark)


@pytest.mark.parametrize("center", [(40.0, 30.0), (40.5, 30.5), (39.3, 30.77), (41.13, 28.01)])
@pytest.mark.parametrize("axes", [(11.0, 11.0), (7.2, 9.1)])
def test_a_disc_has_its_area_and_centre(center: tuple[float, float], axes: tuple[float, float]) -> None:
    # Blue of this red is 38, a whole grey level: only the edge is rounded.
    area, mean, _ = moments(drawn_share(Disc(np.array(center), axes, 0.0, 0.8, 190 / 255), FLAT))
    # Rounding to grey levels, sd 0.29 / 180 on some 70 pixels of edge: 0.014 px of area, 5e-4 px of centre; 5 sd.
    assert area == pytest.approx(np.pi * axes[0] * axes[1], abs=0.3)
    np.testing.assert_allclose(mean, center, atol=0.004)


def test_blur_adds_its_variance_to_the_disc() -> None:
    disc = Disc(np.array([40.2, 30.1]), (8.0, 8.0), 0.0)
    # A disc has r² / 4 along an axis, a pixel 1/12; the variance of a sum is the sum of variances.
    for blur_px, rel in ((0.0, 5e-3), (1.5, 1e-2)):
        _, _, variance = moments(drawn_share(disc, replace(FLAT, blur_sd_px=blur_px)))
        np.testing.assert_allclose(variance, 8.0**2 / 4 + 1 / 12 + blur_px**2, rtol=rel)


def test_a_moving_disc_is_smeared_about_the_middle_of_its_way() -> None:
    disc = Disc(np.array([40.2, 30.1]), (6.0, 6.0), 0.0, smear_px=(9.0, 0.0))
    _, mean, variance = moments(drawn_share(disc, FLAT))
    np.testing.assert_allclose(mean, [40.2, 30.1], atol=0.01)
    # Uniform motion over 9 px adds 9² / 12 along u, less 1/19² for the 19 moments, and nothing along v.
    np.testing.assert_allclose(variance, [9.0 + 1 / 12 + 81 / 12, 9.0 + 1 / 12], rtol=1e-2)


def test_noise_has_its_variance_and_grows_with_light() -> None:
    rng = np.random.default_rng(1)
    lighting = replace(FLAT, noise_sd=2.0, shot_noise_sd=3.0)
    for level in (40.0, 200.0):
        image = draw_frame((320, 240), [], replace(lighting, background_bgr=(level,) * 3), rng)
        expected = np.sqrt(2.0**2 + 3.0**2 * level / 255.0 + 1.0 / 12.0)  # and rounding
        # 230,400 numbers: the deviation is known to 0.15 %; 5 sd.
        assert image.std() == pytest.approx(expected, rel=0.01)
        assert image.mean() == pytest.approx(level, abs=0.05)


@pytest.mark.parametrize(("grain_px", "expected"), [(0.0, 0.0), (1.5, np.exp(-1 / (4 * 1.5**2)))])
def test_grain_is_the_noise_of_neighbours(grain_px: float, expected: float) -> None:
    image = draw_frame(
        (320, 240), [], replace(FLAT, background_bgr=(128.0,) * 3, noise_sd=12.0, grain_px=grain_px),
        np.random.default_rng(2),
    )  # fmt: skip
    noise = image[:, :, 1].astype(float) - image[:, :, 1].mean()
    # White noise under a Gaussian of spread s has the autocorrelation exp(-d² / 4 s²).
    correlation = (noise[:, 1:] * noise[:, :-1]).mean() / noise.var()
    assert correlation == pytest.approx(expected, abs=0.03)


@pytest.mark.parametrize("hue_deg", [0.0, 120.0, 240.0, 305.0])
def test_a_disc_has_its_colour(hue_deg: float) -> None:
    image = draw_frame((80, 60), [Disc(np.array([40.0, 30.0]), (9.0, 9.0), hue_deg)], FLAT, np.random.default_rng(0))
    hue, saturation, value = cv2.cvtColor(image[30:31, 40:41].astype(np.float32) / 255.0, cv2.COLOR_BGR2HSV)[0, 0]
    assert hue_distance(hue, hue_deg) < 1.0  # grey levels are rounded
    assert (saturation, value) == pytest.approx((0.85, 0.75), abs=0.01)


def test_marks_cover_lines_and_frames_cut_discs() -> None:
    disc = Disc(np.array([-2.0, 30.0]), (9.0, 9.0), 0.0)
    hidden = Disc(np.array([40.0, 30.0]), (9.0, 9.0), 0.0)
    rng = np.random.default_rng(0)
    with_lines = draw_frame((80, 60), [disc, hidden], FLAT, rng, lines=[((-20.0, 30.0), (200.0, 30.0))])
    without = draw_frame((80, 60), [disc, hidden, Disc(np.array([500.0, 30.0]), (9.0, 9.0), 0.0)], FLAT, rng)
    np.testing.assert_array_equal(with_lines[30, 33:48], without[30, 33:48])
    assert (with_lines[30, 55:75] == 120).all()
    assert without[30, 0, 2] - without[30, 0, 1] > 100  # red at the border


def test_distractors_keep_clear_of_hues() -> None:
    discs = distractors(40, (640, 480), np.random.default_rng(5), [0.0, 120.0])
    assert len(discs) == 40
    assert min(hue_distance(d.hue_deg, kept) for d in discs for kept in (0.0, 120.0)) >= 50.0
    assert len({d.hue_deg for d in discs}) > 10
    with pytest.raises(ValueError, match="expected to leave a hue free"):
        distractors(1, (640, 480), np.random.default_rng(5), [0.0, 90.0, 180.0, 270.0])


def test_bad_records_are_refused() -> None:
    with pytest.raises(ValueError, match="disc axes_px: expected more than 0"):
        Disc(np.array([1.0, 1.0]), (0.0, 3.0), 0.0)
    with pytest.raises(ValueError, match="disc center_px: expected two finite numbers"):
        Disc(np.array([1.0, np.nan]), (3.0, 3.0), 0.0)
    with pytest.raises(ValueError, match="lighting noise_sd: expected 0 or more, found -1"):
        Lighting(noise_sd=-1)
    with pytest.raises(ValueError, match="lighting mark_strength"):
        Lighting(mark_strength=0.0)
