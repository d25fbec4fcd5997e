"""Needles, hands, blood and surfaces: their places, sizes and colours."""

import colorsys

import numpy as np
import pytest

from vision import (
    Layer,
    OccludingHand,
    OccludingNeedle,
    blood_layer,
    hand_layer,
    hue_distance,
    needle_layers,
    plain_surface,
    srgb_of,
)
from vision.synthetic.layers import take

SIZE = (320, 240)


def cover(layers: list[Layer]) -> np.ndarray:
    free = np.ones((SIZE[1], SIZE[0]), dtype=np.float32)
    for layer in layers:
        take(free, layer)
    return 1.0 - free


@pytest.mark.parametrize(
    ("tip", "tail"),
    [((40.0, 120.0), (280.0, 120.0)), ((160.3, 20.0), (160.3, 220.0)), ((30.0, 31.0), (290.0, 200.0)),
     ((290.0, 31.0), (60.0, 60.5))],
)  # fmt: skip
def test_a_needle_has_its_width_and_ends(tip: tuple[float, float], tail: tuple[float, float]) -> None:
    layers = needle_layers(OccludingNeedle(tip, tail, 5.0), SIZE)
    length = np.hypot(tail[0] - tip[0], tail[1] - tip[1])
    # A bar of width 5 whose first 15 px are ground to a triangle; its edges are good to a tenth of a pixel.
    assert cover(layers).sum() == pytest.approx(5.0 * (length - 15.0) + 0.5 * 5.0 * 15.0, rel=0.02)
    v, u = np.nonzero(cover(layers) > 0.02)
    along = ((u - tip[0]) * (tail[0] - tip[0]) + (v - tip[1]) * (tail[1] - tip[1])) / length
    across = ((u - tip[0]) * (tail[1] - tip[1]) - (v - tip[1]) * (tail[0] - tip[0])) / length
    assert np.abs(across).max() < 3.1
    assert along.min() == pytest.approx(0.0, abs=3.0)
    assert along.max() == pytest.approx(length, abs=1.0)


def test_a_needle_is_grey_metal_with_a_bright_streak_and_its_bands_do_not_overlap() -> None:
    layers = needle_layers(OccludingNeedle((30.0, 31.0), (290.0, 200.0), 5.0, gloss=0.9), SIZE)
    assert max(layer.alpha.shape[0] for layer in layers) <= 32
    assert sum(layer.alpha.sum() for layer in layers) == pytest.approx(cover(layers).sum(), rel=1e-5)
    colors = np.concatenate([layer.color_bgr[layer.alpha > 0.99] for layer in layers])
    assert np.ptp(colors, axis=1).max() < 0.05 * colors.max()
    assert colors.max() > 0.9
    assert np.median(colors) < 0.6
    assert needle_layers(OccludingNeedle((-500.0, -500.0), (-50.0, -400.0), 5.0), SIZE) == []


def test_a_hand_points_with_its_tip_and_is_of_skin() -> None:
    hand = OccludingHand((150.0, 100.0), 0.0, 12.0, n_fingers=1, softness_px=2.0)
    layer = hand_layer(hand, SIZE)
    alpha = cover([layer])
    # Its finger is a bar of 24 px with a round end: half covered at the tip.
    ahead = np.nonzero(alpha[100] > 0.5)[0].max()
    assert ahead == pytest.approx(150.0, abs=1.5)
    assert alpha[:, 110].sum() == pytest.approx(24.0, abs=0.8)
    assert alpha[100, 0] > 0.99  # it comes from beyond the picture
    # The soft outline is a Gaussian's: density of the edge along the column through the finger.
    edge = np.diff(alpha[70:100, 110])
    v = np.arange(edge.size)
    mean = (v * edge).sum() / edge.sum()
    assert np.sqrt(((v - mean) ** 2 * edge).sum() / edge.sum()) == pytest.approx(2.0, abs=0.4)
    blue, green, red = srgb_of(layer.color_bgr[layer.alpha > 0.99].mean(axis=0))
    hue, saturation, _ = colorsys.rgb_to_hsv(red, green, blue)
    assert 5.0 < 360.0 * hue < 40.0
    assert 0.2 < saturation < 0.7


def test_blood_is_dark_varied_red_and_drops_are_smaller_than_marks() -> None:
    rng = np.random.default_rng(1)
    layer = blood_layer(SIZE, 9.0, rng, n_smears=3, n_streaks=4, n_drops=10)
    red = srgb_of(layer.color_bgr[layer.alpha > 0.5])[:, ::-1]
    hues = [360.0 * colorsys.rgb_to_hsv(*color)[0] for color in red[::37]]
    assert max(hue_distance(hue, 0.0) for hue in hues) < 12.0
    assert red[:, 0].max() < 0.7
    assert red[:, 0].std() > 0.05
    one = blood_layer(SIZE, 9.0, np.random.default_rng(2), n_smears=0, n_streaks=0, n_drops=1)
    assert 0 < one.alpha.sum() < 0.6**2 * np.pi * 9.0**2
    assert blood_layer(SIZE, 9.0, rng, n_smears=0, n_streaks=0, n_drops=0).alpha.max() == 0.0


def test_a_surface_has_its_colour_and_is_uneven_by_its_texture() -> None:
    even = plain_surface(SIZE, (0.8, 0.6, 0.4), np.random.default_rng(0))
    np.testing.assert_allclose(srgb_of(even[10, 10]), [0.4, 0.6, 0.8], atol=1e-6)
    assert np.ptp(even, axis=(0, 1)).max() == 0
    rough = plain_surface(SIZE, (0.8, 0.6, 0.4), np.random.default_rng(0), texture=0.05) / even
    # Three unrelated parts of 0.7, 0.5 and 0.5: their variances add up to 0.99. The coarsest has some 50 grains.
    assert rough[:, :, 1].std() == pytest.approx(0.05, rel=0.25)
    assert rough.mean() == pytest.approx(1.0, abs=0.02)
