"""Marks found frame after frame: where they are expected, named, and none where there is none."""

from dataclasses import replace

import numpy as np
import pytest

import vision.tracking.stages
from tests.vision.tracking.drawn_marks import HOMES, expected, frame
from vision import Disc, Expected, HueError, MarkFinder, MarkHue, Outline, detect_marks
from vision.detection.fast_path import detect_isolated
from vision.tracking.settings import FINDER
from vision.tracking.stages import STAGES


def test_marks_are_found_by_name_whole_picture_or_part(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, regions = np.random.default_rng(1), []
    detect, alone = vision.tracking.stages.detect_marks, vision.tracking.stages.detect_isolated

    def watched(*given, **more):
        regions.append(more["region"])
        return detect(*given, **more)

    def watched_alone(frame_bgr, hues, boxes, expected, settings):
        regions.extend(boxes)
        return alone(frame_bgr, hues, boxes, expected, settings)

    monkeypatch.setattr(vision.tracking.stages, "detect_marks", watched)
    monkeypatch.setattr(vision.tracking.stages, "detect_isolated", watched_alone)
    finder = MarkFinder([MarkHue(0.0)])
    for k in range(5):
        places = {name: np.array([at[0] + 3.0 * k, at[1] + 0.3]) for name, at in HOMES.items()}
        found = {f.name: f.detection.center_px for f in finder.find(frame(places, rng), expected(places))}
        assert found.keys() == places.keys()
        for name, at in places.items():
            assert np.abs(found[name] - at).max() < 0.1
    assert regions[0] is None
    assert len(regions) == 1 + 4 * 3
    assert all(region is not None and region[2] * region[3] < 80 * 80 for region in regions[1:])


def test_a_mark_that_leaves_its_place_is_looked_for_everywhere() -> None:
    rng = np.random.default_rng(2)
    finder = MarkFinder([MarkHue(0.0)])
    finder.find(frame(HOMES, rng), expected(HOMES))
    expected_after_impulse = HOMES | {"M3": np.array([520.0, 260.0])}
    assert {f.name for f in finder.find(frame(expected_after_impulse, rng), expected(HOMES))} == {"M1", "M4"}

    def anywhere(name: str) -> Expected:
        return Expected(name, np.array(HOMES[name]), 100.0**2 * np.eye(2), 0.0, Outline(10.0 * np.eye(2), 0.05))

    found = {
        f.name: f.detection.center_px
        for f in finder.find(frame(expected_after_impulse, rng), expected(HOMES), anywhere)
    }
    np.testing.assert_allclose(found["M3"], expected_after_impulse["M3"], atol=0.1)


def test_of_two_strangers_none_is_taken_for_the_missing_mark_at_once() -> None:
    rng = np.random.default_rng(3)
    finder = MarkFinder([MarkHue(0.0)])
    finder.find(frame(HOMES, rng), expected(HOMES))
    left = {name: at for name, at in HOMES.items() if name != "M3"}
    strangers = [Disc(np.array([560.0, 300.0]), (10.0, 10.0), 0.0), Disc(np.array([60.0, 300.0]), (10.0, 10.0), 0.0)]

    def near(name: str) -> Expected:
        return Expected(name, np.array([540.0, 290.0]), 30.0**2 * np.eye(2), 0.0, Outline(10.0 * np.eye(2), 0.05))

    image = frame(left, rng, *strangers)
    assert {f.name for f in finder.find(image, expected(HOMES), near)} == {"M1", "M4"}
    # it stays away: then the one that a disturbance may have moved there is it
    found = {f.name: f.detection.center_px for f in finder.find(image, expected(HOMES), near)}
    np.testing.assert_allclose(found["M3"], (560.0, 300.0), atol=0.1)


def test_a_hand_of_nearly_the_same_hue_is_no_mark() -> None:
    rng = np.random.default_rng(4)
    finder = MarkFinder([MarkHue(0.0, 25.0, saturation=0.85, value=0.75)])
    finder.find(frame(HOMES, rng), expected(HOMES))
    hand = Disc(np.array([450.0, 130.0]), (60.0, 40.0), 18.0, saturation=0.5, value=0.7)
    spot = Disc(np.array([452.0, 131.0]), (9.0, 9.0), 18.0, saturation=0.5, value=0.7)
    left = {name: at for name, at in HOMES.items() if name != "M3"}
    for covering in (hand, spot):
        found = finder.find(frame(left, rng, covering), expected(HOMES))
        assert {f.name for f in found} == {"M1", "M4"}


def test_marks_that_cross_keep_their_names() -> None:
    rng = np.random.default_rng(5)
    finder = MarkFinder([MarkHue(0.0)])
    for k in range(0, 60, 2):
        places = {
            "M1": np.array([150.0 + 4.0 * k, 200.0 + 0.4 * k]),
            "M3": np.array([390.0 - 4.0 * k, 212.0 - 0.4 * k]),
        }
        off = {name: at + rng.normal(0.0, 1.5, 2) for name, at in places.items()}
        for f in finder.find(frame(places, rng), expected(off, 1.5)):
            own, other = places[f.name], places["M3" if f.name == "M1" else "M1"]
            assert np.hypot(*(f.detection.center_px - own)) < max(3.0, 0.6 * np.hypot(*(own - other)))
    assert finder.missed == set()


def test_a_hue_that_is_everywhere_is_an_error_at_first_and_a_hand_before_the_camera_later() -> None:
    red = np.full((480, 640, 3), (30, 30, 200), np.uint8)
    with pytest.raises(HueError, match="expected marks on up to 30%"):
        MarkFinder([MarkHue(0.0)]).find(red, expected(HOMES))
    finder = MarkFinder([MarkHue(0.0)])
    finder.find(frame(HOMES, np.random.default_rng(6)), expected(HOMES))
    assert finder.find(red, expected(HOMES)) == []
    assert finder.missed == set(HOMES)


def test_the_quick_way_says_what_the_long_way_says() -> None:
    rng = np.random.default_rng(7)
    for _ in range(10):
        at = rng.uniform((100.0, 100.0), (540.0, 380.0))
        image = frame({"M1": at}, rng)
        (one,) = expected({"M1": at + rng.normal(0.0, 2.0, 2)})
        left, top = (int(x) - 40 for x in one.center_px)
        (quick,) = detect_isolated(image, [MarkHue(0.0)], [(left, top, 80, 80)], [one])
        (slow,) = detect_marks(
            image, [MarkHue(0.0)], min_area_px=100.0, region=(left, top, 80, 80), outlines=[one.outline]
        )
        assert quick is not None
        np.testing.assert_allclose(quick.center_px, slow.center_px, atol=0.02)
        np.testing.assert_allclose(quick.cov_px2, slow.cov_px2, rtol=0.5, atol=1e-5)
        assert quick.area_px == pytest.approx(slow.area_px, rel=0.01)
        np.testing.assert_allclose(quick.color_bgr, slow.color_bgr, atol=3.0)


def test_the_quick_way_leaves_what_is_odd_to_the_long_way() -> None:
    rng = np.random.default_rng(8)
    at = np.array([300.0, 200.0])
    (one,) = expected({"M1": at})
    region, hues = (255, 155, 90, 90), [MarkHue(0.0)]
    whole = frame({"M1": at}, rng)
    (clear,) = detect_isolated(whole, hues, [region], [one])
    assert clear is not None
    half = whole.copy()
    half[:, 302:] = (150, 160, 170)
    two = frame({"M1": at, "M3": np.array([326.0, 200.0])}, rng)
    stain = Disc(at, (3.0, 3.0), 0.0)
    for image in (half, two, frame({}, rng), frame({}, rng, stain)):
        assert detect_isolated(image, hues, [region], [one]) == [None]
    assert detect_isolated(whole, hues, [(296, 155, 49, 90)], [one]) == [None]  # cut by the region
    ball = replace(one, outline=replace(one.outline, even=False))
    assert detect_isolated(whole, hues, [region], [ball]) == [None]
    # of several regions each by itself
    none, again = detect_isolated(whole, hues, [(20, 20, 90, 90), region], [ball, one])
    assert none is None
    assert again is not None
    np.testing.assert_array_equal(again.center_px, clear.center_px)
    np.testing.assert_array_equal(again.cov_px2, clear.cov_px2)


def test_marks_of_one_hue_have_one_range_of_colours() -> None:
    finder = MarkFinder([MarkHue(0.0, min_saturation=0.3), MarkHue(120.0), MarkHue(0.0, min_saturation=0.3)])
    assert list(finder.hues) == [0.0, 120.0]
    with pytest.raises(HueError, match=r"marks of hue 0 degrees: expected one min_saturation .* found 0.3 and 0.5"):
        MarkFinder([MarkHue(0.0, min_saturation=0.3), MarkHue(0.0, min_saturation=0.5)])


def test_an_unknown_stage_is_an_error_that_lists_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"expected some of isolated, regions, .*, ambiguity, found 'guess'"):
        MarkFinder([MarkHue(0.0)], replace(FINDER, stages=("picture", "guess")))


def test_every_stage_is_named_in_the_settings() -> None:
    assert tuple(stage.name for stage in STAGES) == FINDER.stages


def test_a_stage_left_out_does_not_run() -> None:
    rng = np.random.default_rng(9)
    image = frame(HOMES, rng)
    assert len(MarkFinder([MarkHue(0.0)], replace(FINDER, stages=("picture",))).find(image, expected(HOMES))) == 3
    assert MarkFinder([MarkHue(0.0)], replace(FINDER, stages=("regions",))).find(image, expected(HOMES)) == []
