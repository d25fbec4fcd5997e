"""A distractor in the colour of a mark is reported within three frames, once; what was there before is not."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.vision.tracking.drawn_marks import HOMES, expected
from vision import AdaptiveHue, MarkFinder, MarkHue
from vision.arrays import Image
from vision.tracking.distractors import Distractor
from vision.tracking.settings import FINDER

SIZE = (480, 640)
RED, BLUE = (40, 30, 190), (200, 60, 30)
HUES = {"M1": 0.0, "M3": 240.0, "M4": 0.0}
RADIUS = 10
SETTLED = FINDER.distractors.settled_frames


@lru_cache
def noise(k: int) -> NDArray[np.int16]:
    """One of several images of noise of 3 grey levels."""
    return np.random.default_rng(k).normal(0.0, 3.0, (*SIZE, 3)).round().astype(np.int16)


def picture(
    rng: np.random.Generator, *discs: tuple[tuple[float, float], int, tuple[int, int, int]], without=()
) -> Image:
    """Grey, with the marks but for some, and discs: where, how large, of which colour; noise of 3 grey levels."""
    image = np.full((*SIZE, 3), 130, np.uint8)
    marks = [(at, RADIUS, RED if HUES[name] == 0.0 else BLUE) for name, at in HOMES.items() if name not in without]
    for (u, v), radius, colour in (*discs, *marks):
        cv2.circle(image, (round(u), round(v)), radius, colour, -1, cv2.LINE_AA)
    return np.clip(image + noise(int(rng.integers(8))), 0, 255).astype(np.uint8)


def reported(pictures: Sequence[Image]) -> list[tuple[int, Distractor]]:
    """The reports, and in which picture."""
    finder = MarkFinder([MarkHue(0.0), MarkHue(240.0)], explain=True)
    found = []
    for k, image in enumerate(pictures):
        finder.find(image, expected(HOMES, 2.0, HUES))
        found += [(k, one) for one in finder.came]
    return found


CLOTH = ((560.0, 400.0), 15, RED)
FIRST = SETTLED + 5


@pytest.mark.parametrize(("colour", "like", "hue_deg"), [(RED, "M4", 0.0), (BLUE, "M3", 240.0)])
def test_something_of_a_marks_size_and_colour_that_comes_is_reported_in_the_third_frame_and_once(colour, like, hue_deg):
    rng = np.random.default_rng(0)
    before = [picture(rng, CLOTH) for _ in range(FIRST)]
    after = [picture(rng, CLOTH, ((380.0, 300.0), RADIUS, colour)) for _ in range(40)]
    ((k, one),) = reported(before + after)
    assert k == FIRST + 2
    assert (one.like, one.hue_deg) == (like, hue_deg)
    assert 0.5 < one.size < 1.5
    if colour == BLUE:  # of red the cloth is larger
        np.testing.assert_allclose(one.center_px, (380.0, 300.0), atol=6.0)


def test_what_grows_is_reported_when_it_is_twice_as_large_and_what_went_and_comes_again_is() -> None:
    rng = np.random.default_rng(1)
    radii = [*[0] * FIRST, *np.repeat(np.arange(8, 44, 2), 3), *[0] * 10, *[20] * 10]
    found = reported([picture(rng, *([((380.0, 300.0), int(r), BLUE)] if r else [])) for r in radii])
    sizes = np.array([one.size for _, one in found])
    grown, again = sizes[:-1], sizes[-1]
    assert len(grown) >= 4
    assert (grown[1:] >= 2.0 * grown[:-1]).all()
    assert grown[-1] > 0.5 * (max(radii) / RADIUS) ** 2
    assert again == pytest.approx(4.0, rel=0.3)


def test_speckles_a_flash_of_two_frames_and_a_marks_own_return_are_nothing() -> None:
    rng = np.random.default_rng(2)
    pictures = [picture(rng, CLOTH) for _ in range(FIRST)]
    for _ in range(30):  # specks of two pixels: of more area than ten marks in all
        specked = picture(rng, CLOTH)
        u, v = rng.integers(0, 638, 2000), rng.integers(0, 478, 2000)
        specked[v, u] = specked[v, u + 1] = RED
        pictures.append(specked)
    pictures += [picture(rng, CLOTH, ((380.0, 300.0), 20, RED)) for _ in range(2)]
    pictures += [picture(rng, CLOTH) for _ in range(3)]
    # a mark that is elsewhere than it may be: it is not found, and that is what is said
    pictures += [picture(rng, CLOTH, ((230.0, 200.0), 15, RED), without=("M1",)) for _ in range(10)]
    assert reported(pictures) == []


def test_what_came_while_a_mark_was_hidden_is_reported_in_the_third_frame_that_shows_all_marks() -> None:
    rng = np.random.default_rng(6)
    blood = ((380.0, 300.0), 15, RED)
    pictures = [picture(rng) for _ in range(FIRST)] + [picture(rng, blood, without=("M1",)) for _ in range(10)]
    found = reported(pictures + [picture(rng, blood) for _ in range(10)])
    assert [k for k, _ in found] == [FIRST + 12]


def test_a_cloth_that_waves_is_nothing_and_what_comes_after_it_went_is_reported() -> None:
    """Its area wavers by a tenth, more than three marks; then it goes, and half as much comes elsewhere."""
    rng = np.random.default_rng(7)
    waves = [picture(rng, (CLOTH[0], 60 + round(3.0 * np.sin(k / 15.0)), RED)) for k in range(-FIRST, 90)]
    found = reported(
        waves + [picture(rng) for _ in range(5)] + [picture(rng, ((200.0, 380.0), 40, RED)) for _ in range(5)]
    )
    assert [k for k, _ in found] == [FIRST + 97]


def test_light_that_goes_and_comes_makes_nothing_come() -> None:
    rng = np.random.default_rng(3)
    cloth = [picture(rng, CLOTH, ((60.0, 420.0), 30, (90, 85, 130))) for _ in range(120)]
    shares = np.concatenate([np.ones(FIRST), np.linspace(1.0, 0.35, 40), np.linspace(0.35, 1.0, 120 - 40 - FIRST)])
    assert reported([(share * image).astype(np.uint8) for share, image in zip(shares, cloth, strict=True)]) == []


def test_what_a_wider_range_of_colours_takes_in_is_no_news(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the 40th frame on paler things are of the marks' colour, a large pale disc among them."""
    rng, n_frames = np.random.default_rng(4), 0

    def follow(self: AdaptiveHue, _seen: object) -> None:
        self.now = replace(self.now, min_saturation=0.2 if n_frames > 40 else 0.6)

    monkeypatch.setattr(AdaptiveHue, "follow", follow)
    finder = MarkFinder([MarkHue(0.0, min_saturation=0.6), MarkHue(240.0)], explain=True)
    pale = ((60.0, 420.0), 50, (90, 85, 150))
    came = []
    for k in range(80):
        n_frames = k
        finder.find(picture(rng, pale, *([((380.0, 300.0), 40, RED)] if k >= 60 else [])), expected(HOMES, 2.0, HUES))
        came += [k] * len(finder.came)
    assert came == [62]
