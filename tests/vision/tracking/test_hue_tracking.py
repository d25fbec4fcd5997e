"""Colours that drift are followed, others are refused."""

import colorsys
from collections.abc import Iterable

import numpy as np
import pytest

from vision import AdaptiveHue, Detection, MarkHue


def seen(hue: float, saturation: float = 0.8, value: float = 0.7, **how: bool) -> Detection:
    red, green, blue = (255.0 * x for x in colorsys.hsv_to_rgb(hue % 360.0 / 360.0, saturation, value))
    clipped, occluded = how.get("clipped", False), how.get("occluded", False)
    return Detection(np.zeros(2), np.eye(2), 300.0, 0.0, clipped, occluded, (blue, green, red))


def after(hue: MarkHue, frames: Iterable[list[Detection]]) -> AdaptiveHue:
    followed = AdaptiveHue(hue)
    for frame in frames:
        followed.follow(frame)
    return followed


def test_a_drift_of_hue_is_followed_through_zero() -> None:
    followed = after(MarkHue(0.0), ([seen(-0.1 * k), seen(-0.1 * k)] for k in range(200)))
    # followed with a lag of the last twenty frames
    assert followed.now.middle_deg == pytest.approx(360.0 - 0.1 * 180.0, abs=1.0)
    assert followed.now.hue_deg == 0.0


def test_a_drift_is_followed_so_far_and_no_further() -> None:
    followed = after(MarkHue(100.0, 20.0), ([seen(100.0 + 0.2 * k)] for k in range(400)))
    assert followed.now.middle_deg == pytest.approx(130.0)


def test_paler_and_darker_marks_still_count() -> None:
    followed = after(MarkHue(0.0), [[seen(0.0, 0.4, 0.3)]] * 200)
    assert followed.now.min_saturation == pytest.approx(0.24, abs=0.01)
    assert followed.now.min_value == pytest.approx(0.09, abs=0.01)
    assert AdaptiveHue(MarkHue(0.0)).now.min_saturation == 0.4


def test_occluded_and_cut_marks_teach_nothing() -> None:
    followed = after(MarkHue(0.0), [[seen(15.0, occluded=True), seen(15.0, clipped=True)]] * 50)
    assert followed.now == MarkHue(0.0)


def test_other_colours_are_refused_once_the_own_is_known() -> None:
    skin = seen(20.0, 0.5)
    assert AdaptiveHue(MarkHue(0.0)).distance(skin) <= 1.0
    followed = after(MarkHue(0.0), [[seen(0.0), seen(2.0)]] * 5)
    assert not followed.distance(skin) <= 1.0
    assert followed.distance(seen(5.0, 0.75, 0.2)) <= 1.0  # in shadow
    learned = AdaptiveHue(MarkHue(0.0, saturation=0.8, value=0.7))
    assert learned.distance(skin) > 1.0
    assert learned.distance(seen(-5.0, 0.85)) <= 1.0
