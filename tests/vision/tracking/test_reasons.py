"""Why marks were not found, on frames drawn so that one thing alone is wrong."""

import numpy as np
import pytest

from tests.vision.tracking.drawn_marks import HOMES, expected
from tests.vision.tracking.drawn_marks import frame as drawn
from vision import Disc, Expected, LostMark, MarkFinder, MarkHue, Outline, Reason

OTHERS = {name: at for name, at in HOMES.items() if name != "M4"}
BLUE = 240.0


def frame(places: dict[str, tuple[float, float]], *more: Disc, radius: float = 10.0) -> np.ndarray:
    return drawn(places, np.random.default_rng(1), *more, radius=radius)


def lost(
    image: np.ndarray, where: list[Expected] | None = None, *, learned: bool = True, hue: MarkHue | None = None
) -> dict[str, LostMark]:
    """What a finder says that saw the marks at home in four frames before, if learned."""
    finder = MarkFinder([MarkHue(0.0) if hue is None else hue], explain=True)
    for _ in range(4 if learned else 0):
        finder.find(frame(HOMES), expected(HOMES))
        assert finder.lost == ()
    found = finder.find(image, expected(HOMES) if where is None else where)
    assert {one.name for one in finder.lost} | {one.name for one in found} == set(HOMES)
    return {one.name: one for one in finder.lost}


def test_a_mark_that_is_covered_shows_too_few_pixels() -> None:
    sliver = lost(frame(HOMES, Disc(np.array([302.0, 350.0]), (9.2, 11.0), BLUE)))
    assert list(sliver) == ["M4"]
    assert sliver["M4"].reason is Reason.FEW_PIXELS
    assert "of at least 63" in sliver["M4"].detail  # a fifth of 100 pi
    assert np.abs(sliver["M4"].candidate_px - [291.7, 350.0]).max() < 2.0  # the sliver left of the cover
    gone = lost(frame(OTHERS))
    assert gone["M4"].reason is Reason.FEW_PIXELS
    assert gone["M4"].candidate_px is None


def test_what_is_left_of_a_mark_says_more_than_another_of_its_hue_elsewhere() -> None:
    cover, other = Disc(np.array([302.6, 350.0]), (9.2, 11.0), BLUE), Disc(np.array([550.0, 400.0]), (10.0, 10.0), 0.0)
    one = lost(frame(HOMES, cover, other))["M4"]
    assert one.reason is Reason.FEW_PIXELS
    assert np.abs(one.candidate_px - [292.0, 350.0]).max() < 2.0


@pytest.mark.parametrize(("diameter_px", "reason"), [(2.6, Reason.SMALL), (6.0, Reason.FEW_PIXELS)])
def test_a_mark_too_small_for_a_block_of_pixels_is_too_small(diameter_px: float, reason: Reason) -> None:
    """Drawn as expected for the first diameter; at the second, which is found where it is drawn, not drawn at all."""
    outline = Outline(diameter_px / 2.0 * np.eye(2), 0.05)
    where = [Expected(name, np.array(at), np.eye(2), 0.0, outline) for name, at in HOMES.items()]
    drawn_at = HOMES if reason is Reason.SMALL else OTHERS
    one = lost(frame(drawn_at, radius=diameter_px / 2.0), where, learned=False)
    assert {each.reason for each in one.values()} == {reason}
    assert set(one) == ({*HOMES} if reason is Reason.SMALL else {"M4"})
    if reason is Reason.SMALL:
        assert one["M4"].detail == "2.6 px across of at least 5.7"  # 2 sqrt 8: a circle of 8 pi px


@pytest.mark.parametrize("radius", [3.3, 5.0, 21.0, 40.0])
def test_a_mark_of_another_diameter_is_of_the_wrong_size(radius: float) -> None:
    one = lost(frame(HOMES, radius=radius), learned=False)
    assert {each.reason for each in one.values()} == {Reason.SIZE}
    assert float(one["M4"].detail.split()[0]) == pytest.approx(radius / 10.0, abs=0.06)
    assert np.abs(one["M4"].candidate_px - HOMES["M4"]).max() < 1.0


def test_a_mark_elsewhere_is_too_far_and_by_how_much() -> None:
    one = lost(frame({**HOMES, "M4": (300.0, 420.0)}))["M4"]
    assert one.reason is Reason.FAR
    assert one.detail.startswith("70 px, 23 sigma")  # 70 px by a standard deviation of 3
    assert np.abs(one.candidate_px - [300.0, 420.0]).max() < 1.0


def test_a_streak_has_the_wrong_shape() -> None:
    one = lost(frame(OTHERS, Disc(np.array([300.0, 350.0]), (40.0, 4.0), 0.0)))["M4"]
    assert one.reason is Reason.SHAPE
    assert float(one.detail.split()[0]) == pytest.approx(10.0, abs=0.5)


def test_a_mark_expected_beyond_the_border_is_outside() -> None:
    one = lost(frame(OTHERS), expected({**HOMES, "M4": (300.0, 500.0)}))["M4"]
    assert one.reason is Reason.OUTSIDE


def test_a_mark_of_another_colour_within_its_range_is_reported() -> None:
    wide = MarkHue(0.0, half_width_deg=60.0)
    one = lost(frame(OTHERS, Disc(np.array([300.0, 350.0]), (10.0, 10.0), 45.0)), hue=wide)["M4"]
    assert one.reason is Reason.COLOUR


def test_the_only_mark_where_two_are_expected_is_taken_for_the_other() -> None:
    near = {**HOMES, "M4": (448.0, 130.0)}
    one = lost(frame({"M1": HOMES["M1"], "M3": HOMES["M3"]}), expected(near), learned=False)
    (name,) = one
    assert name in ("M3", "M4")
    assert one[name].reason is Reason.TAKEN
    assert one[name].detail == ({"M3", "M4"} - {name}).pop()


def test_what_an_impulse_moved_is_not_what_another_mark_is_too_far_as() -> None:
    finder = MarkFinder([MarkHue(0.0)], explain=True)
    finder.find(frame(HOMES), expected(HOMES))
    moved = {"M1": HOMES["M1"], "M3": (520.0, 260.0)}
    anywhere = {
        one.name: Expected(one.name, one.center_px, 1e4 * np.eye(2), 0.0, one.outline) for one in expected(HOMES)
    }
    found = finder.find(frame(moved), expected(HOMES), anywhere.__getitem__)
    assert {one.name for one in found} == {"M1", "M3"}
    (one,) = finder.lost
    assert (one.name, one.reason, one.candidate_px) == ("M4", Reason.FEW_PIXELS, None)


def test_a_hand_over_the_picture_floods_it() -> None:
    one = lost(frame(HOMES, Disc(np.array([320.0, 240.0]), (300.0, 220.0), 0.0)))
    assert {each.reason for each in one.values()} == {Reason.FLOODED}


def test_a_hue_that_only_neighbours_averaged_have_is_no_piece() -> None:
    """Stripes of yellow and magenta: red by twos, as the search has them, neither by ones nor by threes."""
    image = frame(OTHERS)
    image[340:360, 290:310:2], image[340:360, 291:311:2] = (0, 255, 255), (255, 0, 255)
    one = lost(image)["M4"]
    assert one.reason is Reason.FEW_PIXELS
    assert one.candidate_px is None


def test_explaining_changes_no_detection() -> None:
    """Bit for bit, over frames in which marks come and go."""
    finders = [MarkFinder([MarkHue(0.0)], explain=explain) for explain in (False, True)]
    for k in range(12):
        other = Disc(np.array([140.0 + 4.0 * k, 120.0]), (9.0, 9.0), BLUE)
        image = frame({**OTHERS, "M4": (300.0 + 30.0 * (k % 4 == 3), 350.0)}, other)
        found = [{one.name: one.detection for one in finder.find(image, expected(HOMES))} for finder in finders]
        plain, explained = (
            {name: (*one.center_px, *one.cov_px2.ravel()) for name, one in own.items()} for own in found
        )
        assert plain == explained
    assert finders[0].lost == ()
