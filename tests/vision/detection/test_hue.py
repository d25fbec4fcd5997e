import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from vision import MarkHue, hue_distance
from vision.detection.hue import on_circle


@given(st.floats(0, 360, exclude_max=True), st.floats(0, 360, exclude_max=True))
def test_distance_is_the_shorter_way_round(a: float, b: float) -> None:
    assert hue_distance(a, b) == pytest.approx(min(abs(a - b), 360.0 - abs(a - b)), abs=1e-9)


@given(st.floats(-1e4, 1e4))
@example(-1e-15)
def test_every_hue_has_its_place_on_the_circle(deg: float) -> None:
    assert 0.0 <= on_circle(deg) < 360.0
    assert hue_distance(on_circle(deg), deg) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((360.0,), "hue_deg: expected 0 up to 360, found 360"),
        ((0.0, 1.0), "half_width_deg: expected 2 to 90, found 1"),
        ((0.0, 18.0, 0.0), "min_saturation: expected between 0 and 1, found 0"),
        ((0.0, 18.0, 0.4, 1.5), "min_value: expected between 0 and 1, found 1.5"),
    ],
)
def test_bad_hues_are_refused(arguments: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        MarkHue(*arguments)
