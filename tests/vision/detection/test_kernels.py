"""Compiled loops over pixels against NumPy and OpenCV, and against the standard library's own colours."""

import colorsys

import numpy as np
import pytest

from tests.vision.plain_coverage import cover
from vision import Disc, Lighting, MarkHue, compress, draw_frame
from vision.detection.coverage import measure_coverage
from vision.detection.palette import classes_of, palette_of


@pytest.mark.parametrize("seed", range(12))
def test_what_a_mark_covers_is_what_the_plain_version_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    radius = rng.uniform(3.0, 20.0)
    lighting = Lighting(
        noise_sd=rng.uniform(0.0, 10.0), grain_px=float(rng.choice([0.0, 1.2])), blur_sd_px=rng.uniform(0.3, 1.5)
    )
    disc = Disc(np.array([60.0, 50.0]) + rng.uniform(0.0, 1.0, 2), (radius, radius), 0.0)
    patch = compress(draw_frame((120, 110), [disc], lighting, rng), int(rng.integers(50, 100)))
    v, u = np.mgrid[0:110, 0:120]
    component = ((u - 60) ** 2 + (v - 50) ** 2 < (0.9 * radius) ** 2).astype(np.uint8)
    others = np.zeros_like(component)
    (center_px, cov_px2, area_px), got = cover(patch, component, others), measure_coverage(patch, component, others)
    assert got is not None
    # single precision against double
    np.testing.assert_allclose(got.center_px, center_px, atol=1e-5)
    assert got.area_px == pytest.approx(area_px, rel=1e-5)
    # OpenCV rounds the fraction of a pixel to 1/32 when it turns the mark about its centre
    np.testing.assert_allclose(got.cov_px2.diagonal(), cov_px2.diagonal(), rtol=0.02)


def test_alpha_is_one_inside_and_nothing_away_from_the_mark() -> None:
    disc = Disc(np.array([40.0, 40.0]), (10.0, 10.0), 0.0)
    patch = draw_frame((80, 80), [disc], Lighting(), np.random.default_rng(0))
    v, u = np.mgrid[0:80, 0:80]
    away = np.hypot(u - 40, v - 40)
    seen = measure_coverage(patch, (away < 9.5).astype(np.uint8), np.zeros((80, 80), np.uint8))
    assert seen is not None
    assert (seen.alpha[away < 6] == 1.0).all()
    assert (seen.alpha[away > 19] == 0.0).all()
    assert seen.alpha.sum() == pytest.approx(np.pi * 100.0, rel=0.03)
    # grey levels of the noise by those of the contrast: some 1.7 by 150
    assert 0.003 < seen.noise_sd < 0.03


@pytest.mark.parametrize("line", [(slice(0, 1), slice(None)), (slice(None), slice(0, 1)), (slice(None), slice(29, 30))])
def test_pixels_on_one_line_do_not_tell_what_lies_behind(line: tuple[slice, slice]) -> None:
    rng = np.random.default_rng(3)
    patch = draw_frame((30, 30), [Disc(np.array([15.0, 15.0]), (5.0, 5.0), 0.0)], Lighting(), rng)
    component, others = np.zeros((30, 30), np.uint8), np.ones((30, 30), np.uint8)
    component[11:20, 11:20] = 1
    others[line] = 0
    assert measure_coverage(patch, component, others) is None
    others[8:22, :] = 0
    assert measure_coverage(patch, component, others) is not None


def test_every_colour_is_of_the_class_that_its_hue_saturation_and_value_say() -> None:
    hues = (MarkHue(0.0, 20.0, 0.4, 0.2), MarkHue(130.0, 40.0, 0.2, 0.5), MarkHue(60.0, 50.0, 0.5, 0.1))
    rng = np.random.default_rng(1)
    colors = rng.integers(0, 256, (60, 70, 3), dtype=np.uint8)
    # searched one pixel at a time: what is smoothed is one colour
    palette = palette_of(hues)
    for b, g, r in colors[:20, :20].reshape(-1, 3).tolist():
        hue, saturation, value = colorsys.rgb_to_hsv(r / 255.0, g / 255.0, b / 255.0)
        off = [abs((360.0 * hue - one.hue_deg + 180.0) % 360.0 - 180.0) for one in hues]
        near = [k for k, one in enumerate(hues) if off[k] <= one.half_width_deg]
        best = min(near, key=lambda k: off[k], default=None)
        edges = [abs(off[k] - one.half_width_deg) for k, one in enumerate(hues)]
        edges += [abs(off[0] - off[2]), abs(off[1] - off[2])]
        levels = [s for one in hues for s in (abs(saturation - one.min_saturation), abs(value - one.min_value))]
        if min(edges) < 0.6 or min(levels) < 0.01:
            continue  # the table knows half degrees
        right = best is not None and saturation >= hues[best].min_saturation and value >= hues[best].min_value
        got = classes_of(np.full((3, 3, 3), (b, g, r), np.uint8), palette, 1)
        assert (got == (best + 1 if right and best is not None else 0)).all(), (b, g, r)
