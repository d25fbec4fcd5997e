"""Hues learned from one place: of drawn marks whose hue is known, in other light, and where there is no mark."""

import numpy as np
import pytest

from vision import Disc, HueError, Lighting, detect_marks, draw_frame, hue_distance, learn_hue

SIZE = (320, 240)


@pytest.mark.parametrize("hue", [0.0, 45.0, 130.0, 355.0])
def test_the_hue_of_a_mark_is_learned_wherever_it_is_clicked(hue: float) -> None:
    rng = np.random.default_rng(1)
    center = np.array([150.0, 110.0])
    image = draw_frame(SIZE, [Disc(center, (14.0, 14.0), hue)], Lighting(), rng)
    for off in ((0.0, 0.0), (7.0, 4.0), (-6.0, -7.0)):
        learned = learn_hue(image, center + off)
        assert hue_distance(learned.hue_deg, hue) < 2.0
        assert learned.half_width_deg < 15.0
        assert learned.saturation == pytest.approx(0.85, abs=0.05)
        (found,) = detect_marks(image, [learned], min_area_px=200.0)
        assert np.abs(found.center_px - center).max() < 0.1


def test_a_pale_mark_before_a_tinted_wall_is_learned_apart_from_it() -> None:
    rng = np.random.default_rng(2)
    marks = [Disc(np.array([90.0, 80.0]), (16.0, 16.0), 120.0, saturation=0.2)]
    image = draw_frame(SIZE, marks, Lighting(background_bgr=(150.0, 160.0, 170.0)), rng)
    learned = learn_hue(image, (95.0, 84.0))
    assert hue_distance(learned.hue_deg, 120.0) < 6.0
    assert learned.min_saturation < 0.15
    (found,) = detect_marks(image, [learned], min_area_px=200.0)
    assert np.abs(found.center_px - (90.0, 80.0)).max() < 0.3


def test_what_is_no_mark_is_reported() -> None:
    image = draw_frame(SIZE, [Disc(np.array([90.0, 80.0]), (2.0, 2.0), 0.0)], Lighting(), np.random.default_rng(3))
    with pytest.raises(ValueError, match="place: expected one inside 320 x 240 px, found 400, 10"):
        learn_hue(image, (400.0, 10.0))
    with pytest.raises(HueError, match="expected a mark of 12 or more pixels alike, found"):
        learn_hue(image, (90.0, 80.0))
    with pytest.raises(HueError, match=r"place 200, 150: expected .*; point at"):
        learn_hue(image, (200.0, 150.0))
