"""Drawn real cameras: with all effects off the closed-form picture, and each effect against its own law."""

from dataclasses import replace

import numpy as np
import pytest

from vision import (
    Highlight,
    Layer,
    Sensor,
    Shadow,
    SyntheticCamera,
    SyntheticMark,
    draw_synthetic_frame,
    exposure_path,
    light_of,
    tilted_view,
)

SIZE = (160, 120)
SQUARE = tilted_view(SIZE, 300.0, 1.0)
PLAIN = SyntheticCamera(SQUARE)
WHITE = np.ones((120, 160, 3), dtype=np.float32)


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def mark(x_mm: float, y_mm: float, radius_mm: float = 12.3) -> SyntheticMark:
    return SyntheticMark(np.array([[1e-3 * x_mm, 1e-3 * y_mm]]), 1e-3 * radius_mm, 0.0, 1.0, 1.0)


def share_of(image: np.ndarray) -> np.ndarray:
    """The share of each pixel that a red mark of saturation 1 takes of a white surface."""
    return 1.0 - image[:, :, 0] / 255.0


def moments(share: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    v, u = np.indices(share.shape)
    area = share.sum()
    mean = np.array([(u * share).sum(), (v * share).sum()]) / area
    return area, mean, np.array([((u - mean[0]) ** 2 * share).sum(), ((v - mean[1]) ** 2 * share).sum()]) / area


@pytest.mark.parametrize("place", [(0.0, 0.0), (3.31, -7.77), (-20.25, 11.4)])
def test_without_effects_the_picture_is_the_disc(place: tuple[float, float]) -> None:
    frame = draw_synthetic_frame(PLAIN, WHITE, [mark(*place)], rng())
    area, mean, _ = moments(share_of(frame.image))
    # One pixel a millimetre: the area is π r², to 0.2 %; rounding to grey levels moves the centre by 4e-4 px (1 sd).
    assert area == pytest.approx(np.pi * 12.3**2, rel=2e-3)
    np.testing.assert_allclose(mean, [79.5 + place[0], 59.5 - place[1]], atol=2e-3)
    np.testing.assert_allclose(frame.centers_px, [[79.5 + place[0], 59.5 - place[1]]], atol=1e-9)
    assert frame.visible == pytest.approx([1.0])


def test_the_truth_is_the_picture_of_the_discs_centre() -> None:
    view = tilted_view(SIZE, 150.0, 1.0, tilt_deg=(30.0, 20.0, 0.0), distortion=(-0.2, 0.02, 0.001, -0.001, 0.0))
    path = np.array([[-0.004, 0.001], [0.0, 0.0025], [0.006, 0.0]])
    frame = draw_synthetic_frame(SyntheticCamera(view), WHITE, [SyntheticMark(path, 0.015, 0.0)], rng())
    np.testing.assert_allclose(frame.centers_px[0], view.project([[0.0, 0.0025]])[0], atol=1e-9)


def test_vignetting_is_cos_to_the_fourth() -> None:
    image = draw_synthetic_frame(replace(PLAIN, vignetting=1.0), WHITE, [], rng()).image
    for u, v in ((80, 60), (0, 60), (0, 0), (159, 119)):
        off = np.hypot(u - 79.5, v - 59.5) / 300.0
        assert image[v, u, 0] == pytest.approx(255.0 * np.cos(np.arctan(off)) ** 4, abs=0.51)
    strong = draw_synthetic_frame(replace(PLAIN, vignetting=2.0), WHITE, [], rng()).image
    assert strong[0, 0, 0] == pytest.approx(float(image[0, 0, 0]) ** 2 / 255.0, abs=1.5)


def test_lens_blur_adds_its_variance() -> None:
    _, mean, variance = moments(
        share_of(draw_synthetic_frame(replace(PLAIN, blur_sd_px=2.0), WHITE, [mark(0, 0)], rng()).image)
    )
    np.testing.assert_allclose(mean, [79.5, 59.5], atol=2e-3)
    np.testing.assert_allclose(variance, 12.3**2 / 4 + 1 / 12 + 4.0, rtol=3e-3)


def test_motion_blur_adds_the_variance_of_the_exposures_path() -> None:
    speed = np.array([0.6, -0.2])  # m/s: 600 and 200 px/s
    path = exposure_path(lambda t: t[:, None] * speed, 0.02, 0.5 / 30.0, 1e-3)
    frame = draw_synthetic_frame(PLAIN, WHITE, [SyntheticMark(path, 0.0123, 0.0, 1.0, 1.0)], rng())
    area, mean, variance = moments(share_of(frame.image))
    assert area == pytest.approx(np.pi * 12.3**2, rel=2e-3)
    np.testing.assert_allclose(mean, [79.5 + 12.0, 59.5 + 4.0], atol=4e-3)
    np.testing.assert_allclose(frame.centers_px[0], mean, atol=4e-3)
    # Even motion over L adds L² / 12, less 1 / n² of it for n moments.
    way = np.array([10.0, 10.0 / 3.0])
    np.testing.assert_allclose(variance, 12.3**2 / 4 + 1 / 12 + way**2 / 12 * (1 - 1 / len(path) ** 2), rtol=2e-3)


def test_an_exposure_path_is_fine_odd_and_about_its_time() -> None:
    path = exposure_path(lambda t: np.column_stack([np.sin(t), np.cos(t)]), 1.0, 0.5, 0.01)
    assert len(path) % 2 == 1
    assert np.hypot(*np.diff(path, axis=0).T).max() <= 0.01
    np.testing.assert_allclose(path[len(path) // 2], [np.sin(1.0), np.cos(1.0)], atol=1e-12)
    assert np.hypot(*np.diff(path, axis=0).T).sum() == pytest.approx(0.5 * (1 - 1 / len(path)), rel=1e-4)
    assert exposure_path(lambda t: np.column_stack([t, t]), 1.0, 0.0, 0.01).tolist() == [[1.0, 1.0]]


def test_lamp_and_exposure_multiply_light() -> None:
    camera = replace(PLAIN, exposure=0.5, lamp_bgr=(0.4, 0.8, 1.2))
    image = draw_synthetic_frame(camera, WHITE, [], rng()).image
    assert (image == [51, 102, 153]).all()


def test_light_falls_off_along_its_slope() -> None:
    image = draw_synthetic_frame(replace(PLAIN, slope=0.4, slope_deg=90.0), WHITE, [], rng()).image
    assert (image[0] == 255).all()
    assert (image[-1] == 153).all()
    assert (np.ptp(image, axis=1) == 0).all()


def test_flicker_is_a_sine_of_rows() -> None:
    camera = replace(PLAIN, exposure=0.5, flicker=0.2, flicker_period_px=30.0, flicker_phase=0.7)
    image = draw_synthetic_frame(camera, WHITE, [], rng()).image
    expected = 127.5 * (1.0 + 0.2 * np.sin(2 * np.pi * np.arange(120) / 30.0 + 0.7))
    assert np.abs(image[:, 17, 1] - expected).max() < 0.51


def test_a_shadow_takes_its_depth_across_a_soft_edge() -> None:
    shadow = Shadow(0.6, (80.0, 0.0), 0.0, 8.0)
    image = draw_synthetic_frame(replace(PLAIN, shadow=shadow), WHITE, [], rng()).image.astype(float)
    assert image[5, 0, 0] == pytest.approx(255.0, abs=0.6)
    assert image[5, 159, 0] == pytest.approx(102.0, abs=0.6)
    assert image[5, 80, 0] == pytest.approx(178.5, abs=0.6)
    # The edge's profile is a distribution: its derivative has the variance asked for.
    density, u = -np.diff(image[5, :, 0]), np.arange(159) + 0.5
    mean = (u * density).sum() / density.sum()
    assert np.sqrt(((u - mean) ** 2 * density).sum() / density.sum()) == pytest.approx(8.0, rel=0.02)


def test_a_highlight_is_a_white_spot_of_its_size_and_strength() -> None:
    camera = replace(PLAIN, highlight=Highlight(0.3, 0.5, (0.4, 0.2)))
    one, other = (draw_synthetic_frame(c, WHITE, [mark(0, 0, 20.0)], rng()).image for c in (camera, PLAIN))
    gain = (one[:, :, 0].astype(float) - other[:, :, 0]) / 255.0  # of blue, which the mark has none of
    area, mean, _ = moments(gain)
    assert area == pytest.approx(0.5 * np.pi * 6.0**2, rel=0.01)
    np.testing.assert_allclose(mean, [79.5 + 8.0, 59.5 - 4.0], atol=0.02)


def test_visible_shares_count_what_covers_a_mark() -> None:
    half = Layer(0, 0, np.ones((120, 80), dtype=np.float32), np.zeros(3, dtype=np.float32))
    marks = [mark(0, 0), mark(40, 0), mark(-80, 30), mark(300, 0), mark(40, 6.0)]
    frame = draw_synthetic_frame(PLAIN, WHITE, marks, rng(), occluders=[half])
    # Two discs of radius r, d apart, share 2 r² acos(d / 2r) - d / 2 √(4r² - d²).
    r, d = 12.3, 6.0
    lens = 2 * r * r * np.arccos(d / (2 * r)) - d / 2 * np.sqrt(4 * r * r - d * d)
    expected = [0.5, 1.0 - lens / (np.pi * r * r), 0.0, 0.0, 1.0]
    np.testing.assert_allclose(frame.visible, expected, atol=6e-3)
    assert (frame.image[:, :80] == 0).all()
    assert np.isfinite(frame.centers_px).all()
    cut = draw_synthetic_frame(PLAIN, WHITE, [mark(-80, 0)], rng())
    # Half of it is left of u = -0.5.
    np.testing.assert_allclose(cut.visible, [0.5], atol=1e-3)


def test_a_mark_has_its_colour_under_white_light() -> None:
    camera = replace(PLAIN, sensor=Sensor(gamma=True))
    image = draw_synthetic_frame(camera, WHITE, [SyntheticMark(np.zeros((1, 2)), 0.02, 120.0, 0.8, 0.6)], rng()).image
    # Hue 120: green is the value, the others value (1 - saturation).
    assert image[60, 80].tolist() == [31, 153, 31]
    assert float(light_of(0.6)) == pytest.approx(0.3185, abs=1e-4)


def test_bad_records_are_refused() -> None:
    with pytest.raises(ValueError, match="real camera exposure_share: expected 0 to 1, found 2"):
        replace(PLAIN, exposure_share=2.0)
    with pytest.raises(ValueError, match="real camera vignetting: expected 0 or more"):
        replace(PLAIN, vignetting=-1.0)
    with pytest.raises(ValueError, match="real camera lamp_bgr"):
        replace(PLAIN, lamp_bgr=(0.0, 1.0, 1.0))
    with pytest.raises(ValueError, match="real mark path_m: expected an odd count"):
        SyntheticMark(np.zeros((2, 2)), 0.01, 0.0)
    with pytest.raises(ValueError, match="real mark radius_m"):
        SyntheticMark(np.zeros((1, 2)), 0.0, 0.0)
    with pytest.raises(ValueError, match="surface: expected shape"):
        draw_synthetic_frame(PLAIN, WHITE[:50], [], rng())
