"""Drawn sensors against closed forms and statistics: noise, mosaic, white balance, gamma, compression."""

import numpy as np
import pytest

from vision import Sensor, compress, light_of, srgb_of
from vision.synthetic.sensor import develop


def even(level: float, size: tuple[int, int] = (320, 240)) -> np.ndarray:
    return np.full((size[1], size[0], 3), level, dtype=np.float32)


def test_variance_of_noise_is_a_line_in_light() -> None:
    sensor, rng = Sensor(full_well_e=900.0, read_noise_e=9.0), np.random.default_rng(1)
    for level in (0.1, 0.3, 0.6):
        image = develop(even(level), sensor, rng)
        # Poisson's variance of level × 900 electrons, read noise, rounding to grey levels.
        expected = 255.0**2 * (level / 900.0 + (9.0 / 900.0) ** 2) + 1.0 / 12.0
        # 230,400 numbers know a variance to 0.3 %; 5 sd.
        assert image.var() == pytest.approx(expected, rel=0.015)
        assert image.mean() == pytest.approx(255.0 * level, abs=5 * np.sqrt(expected / image.size))


def test_noise_in_the_dark_goes_both_ways() -> None:
    # White balance comes after the noise: it widens it by its gain.
    sensor = Sensor(full_well_e=1000.0, read_noise_e=10.0, gains_bgr=(2.0, 1.0, 1.0))
    image = develop(even(0.1), sensor, np.random.default_rng(2)).astype(float)
    sd = 255.0 * np.sqrt(0.1 / 1000.0 + 0.01**2)
    assert image[:, :, 0].mean() == pytest.approx(51.0, abs=0.1)
    assert image[:, :, 0].std() == pytest.approx(np.sqrt((2 * sd) ** 2 + 1 / 12), rel=0.02)
    assert image[:, :, 1].std() == pytest.approx(np.sqrt(sd**2 + 1 / 12), rel=0.02)
    # Behind a mosaic the colours' means of 1, 2 and 4 pixels are taken before what is below black is cut: a quarter,
    # half and quarter of red and blue, half of green as it is and half of 4. E[max(0, z)] = sd / √(2π).
    dark = develop(even(0.0), Sensor(True, 1000.0, 10.0), np.random.default_rng(3)).astype(float)
    of_red, of_green = 1 / 4 + 1 / 2 / np.sqrt(2) + 1 / 4 / 2, 1 / 2 + 1 / 2 / 2
    assert dark.mean() == pytest.approx(2.55 / np.sqrt(2.0 * np.pi) * (2 * of_red + of_green) / 3, rel=0.02)


def test_a_grey_picture_stays_grey_behind_a_mosaic() -> None:
    image = develop(even(0.4), Sensor(bayer=True), np.random.default_rng(0))
    assert (image == 102).all()
    ramp = np.repeat(np.linspace(0.2, 0.8, 160, dtype=np.float32)[None, :, None], 3, axis=2).repeat(120, axis=0)
    seen = develop(ramp, Sensor(bayer=True), np.random.default_rng(0))[2:-2, 2:-2].astype(int)
    # Means of neighbours are exact on a ramp: nothing but rounding.
    assert np.ptp(seen, axis=2).max() <= 1
    assert np.abs(seen[:, :, 1] - 255.0 * ramp[2:-2, 2:-2, 1]).max() < 0.6


def test_a_mosaic_is_red_green_green_blue() -> None:
    light = even(0.0, (20, 20))
    light[8, 8], light[8, 11] = 0.8, 0.8  # where only red, only green is sensed
    image = develop(light, Sensor(bayer=True), np.random.default_rng(0))
    assert image[8, 8].tolist() == [0, 0, 204]
    assert image[8, 11].tolist() == [0, 204, 0]


def test_gamma_is_srgbs() -> None:
    # IEC 61966-2-1: 18 % of light is 46.1 %, and the line below 0.0031308.
    image = develop(even(0.18), Sensor(gamma=True), np.random.default_rng(0))
    assert (image == round(255 * 0.4613561)).all()
    assert float(srgb_of(0.002)) == pytest.approx(0.02584)
    np.testing.assert_allclose(light_of(srgb_of(np.linspace(0, 1, 99))), np.linspace(0, 1, 99), atol=1e-9)


def test_compression_is_that_of_films() -> None:
    light = np.random.default_rng(4).random((48, 64, 3), dtype=np.float32)
    plain = develop(light, Sensor(), np.random.default_rng(0))
    np.testing.assert_array_equal(
        develop(light, Sensor(jpeg_quality=40), np.random.default_rng(0)), compress(plain, 40)
    )


def test_bad_sensors_are_refused() -> None:
    with pytest.raises(ValueError, match="sensor full_well_e: expected more than 0"):
        Sensor(full_well_e=0.0)
    with pytest.raises(ValueError, match="sensor read_noise_e: expected 0 where full_well_e is infinite"):
        Sensor(read_noise_e=2.0)
    with pytest.raises(ValueError, match="sensor gains_bgr"):
        Sensor(gains_bgr=(1.0, 0.0, 1.0))
    with pytest.raises(ValueError, match="sensor jpeg_quality: expected 1 to 100, found 0"):
        Sensor(jpeg_quality=0)
    with pytest.raises(ValueError, match="expected an even width and height for a mosaic, found 5 x 4"):
        develop(np.zeros((4, 5, 3), dtype=np.float32), Sensor(bayer=True), np.random.default_rng(0))
