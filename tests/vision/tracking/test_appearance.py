"""Where a picture looks like a mark as it was: against places drawn, and against the score written out."""

import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from vision import Disc, Expected, Lighting, Outline, draw_frame
from vision.tracking.appearance import AppearanceModel
from vision.tracking.settings import FINDER

SETTINGS = FINDER.appearance
SIZE, RADIUS = (200, 160), 9.0
OUTLINE = Outline(RADIUS * np.eye(2), 0.05)
BLOOD = {"hue_deg": 0.0, "saturation": 0.9, "value": 0.45}


def frame(rng: np.random.Generator, *discs: Disc, light: Lighting | None = None) -> np.ndarray:
    return draw_frame(SIZE, discs, light or Lighting(), rng)


def mark(at: tuple[float, float]) -> Disc:
    return Disc(np.array(at), (RADIUS, RADIUS), 0.0)


def expected(at: tuple[float, float], sd: float = 3.0) -> Expected:
    return Expected("M1", np.array(at), sd**2 * np.eye(2), 0.0, OUTLINE)


def known(rng: np.random.Generator, n: int = SETTINGS.n_views) -> AppearanceModel:
    look = AppearanceModel(0.0)
    for k in range(n):
        at = (60.0 + 1.3 * k, 70.0 + 0.4 * k)
        look.remember(frame(rng, mark(at)), np.array(at), OUTLINE)
    return look


def test_a_whole_mark_is_placed_between_the_pixels() -> None:
    rng = np.random.default_rng(1)
    look, off = known(rng), []
    for _ in range(8):
        at = np.array([100.0, 80.0]) + rng.uniform(-0.5, 0.5, 2)
        place = look.place(frame(rng, mark(tuple(at))), expected((102.0, 78.0)))
        off.append(place.center_px - at)
        assert place.share > 0.97
        assert place.around < -0.9
        assert place.score > 1.2
    assert np.abs(off).max() < 0.25


def test_half_a_mark_behind_a_plate_is_placed_where_its_other_half_is() -> None:
    rng = np.random.default_rng(3)
    look = known(rng)
    picture = frame(rng, mark((100.0, 80.0)))
    picture[80:, :] = (60, 90, 150)
    place = look.place(picture, expected((101.0, 78.5)))
    assert np.abs(place.center_px - (100.0, 80.0)).max() < 2.0
    assert 0.4 < place.share < 0.6


def test_a_darker_mark_of_the_kind_is_known_only_where_light_may_have_changed() -> None:
    rng = np.random.default_rng(5)
    look = known(rng)
    light = Lighting(background_bgr=(130.0, 132.0, 129.0))
    dark = Disc(np.array([100.0, 80.0]), (RADIUS, RADIUS), 0.0, value=0.46)
    picture = frame(rng, dark, light=light)
    assert look.place(picture, expected((101.0, 79.0))).score < 0.5
    same = look.place(picture, expected((101.0, 79.0)), another=True)
    assert same.score > 1.0
    assert np.abs(same.center_px - (100.0, 80.0)).max() < 0.5


@pytest.mark.parametrize("axes_px", [(6.0, 6.0), (13.0, 13.0), (12.0, 8.0)])
def test_looks_are_lent_to_marks_seen_as_other_shapes(axes_px: tuple[float, float]) -> None:
    rng = np.random.default_rng(11)
    look = AppearanceModel(0.0)
    for k in range(SETTINGS.n_views):
        at = np.array([60.0 + 1.3 * k, 70.0])
        highlight = Disc(at + np.array([3.0, -3.5]), (2.5, 2.5), 0.0, saturation=0.1, value=0.95)
        look.remember(frame(rng, mark(tuple(at)), highlight), at, OUTLINE)
    at = np.array([100.0, 80.0])
    wide, tall = np.array(axes_px) / RADIUS
    off = at + np.array([3.0 * wide, -3.5 * tall])
    highlight = Disc(off, (2.5 * wide, 2.5 * tall), 0.0, saturation=0.1, value=0.95)
    paler = Disc(at, axes_px, 0.0, saturation=0.7, value=0.8)
    there = Expected("M1", at + np.array([2.0, -3.0]), 9.0 * np.eye(2), 0.0, Outline(np.diag(axes_px), 0.05))
    place = look.place(frame(rng, paler, highlight), there, another=True)
    assert place.score > 1.2
    assert np.abs(place.center_px - at).max() < 0.5
    pixels = np.array(place.color_bgr)
    assert pixels[2] == pytest.approx(0.8 * 255.0, abs=8.0)


def test_blood_is_no_mark_in_other_light() -> None:
    rng = np.random.default_rng(12)
    look = known(rng)
    blood = Disc(np.array([100.0, 80.0]), (40.0, 34.0), **BLOOD)
    place = look.place(frame(rng, blood), expected((100.0, 80.0)), another=True)
    assert place.around > 0.5
    assert place.score < 0.7


def test_nothing_is_reported_where_nothing_can_be() -> None:
    rng = np.random.default_rng(6)
    picture = frame(rng, mark((100.0, 80.0)))
    assert AppearanceModel(0.0).place(picture, expected((100.0, 80.0))) is None
    look = known(rng)
    assert look.place(picture, expected((100.0, 80.0), sd=20.0)) is None
    assert look.place(picture, Expected("M1", np.array([100.0, 80.0]), np.eye(2), 0.0)) is None
    assert look.place(picture, expected((-60.0, 80.0))) is None
    pale = AppearanceModel(0.0)
    like_ground = Disc(np.array([60.0, 70.0]), (RADIUS, RADIUS), 0.0, saturation=0.02, value=0.8)
    pale.remember(frame(rng, like_ground), np.array([60.0, 70.0]), OUTLINE)
    assert pale.place(picture, expected((100.0, 80.0))) is None


def test_marks_at_the_border_are_not_remembered() -> None:
    rng = np.random.default_rng(7)
    look = AppearanceModel(0.0)
    look.remember(frame(rng, mark((8.0, 70.0))), np.array([8.0, 70.0]), OUTLINE)
    assert look.place(frame(rng, mark((100.0, 80.0))), expected((100.0, 80.0))) is None


def test_score_and_share_are_those_of_their_definition() -> None:
    rng = np.random.default_rng(8)
    look = known(rng)
    blood = Disc(np.array([108.0, 84.0]), (20.0, 14.0), **BLOOD)
    picture = frame(rng, blood, mark((100.0, 80.0)))
    there = np.array([103.0, 78.0])
    place = look.place(picture, expected((101.0, 79.0)))
    at_there = look.place(picture, expected((101.0, 79.0)), there, within_px=0.0)

    views = [view.picture.astype(float) for view in look._kept]  # they are kept smooth
    half = int(np.ceil((1.0 + SETTINGS.margin) * RADIUS + SETTINGS.ring_px + 1.0))
    v, u = np.mgrid[-half : half + 1, -half : half + 1]
    cut = np.array(
        [
            np.dstack([map_coordinates(view[..., c], [v + at[1], u + at[0]], order=1) for c in range(3)])
            for view, at in zip(views, [kept.center_px for kept in look._kept], strict=True)
        ]
    )
    median = np.median(cut, axis=0)
    sd = SETTINGS.level
    off = np.hypot(u, v) / RADIUS
    begin = 1.0 + SETTINGS.margin + 0.5 / RADIUS
    inside, ring = off <= 1.0 - SETTINGS.margin, (off > begin) & (off <= begin + SETTINGS.ring_px / RADIUS)
    smooth = cv2.GaussianBlur(picture, (0, 0), SETTINGS.blur_px).astype(float)

    def apart(levels: np.ndarray, colors: np.ndarray) -> np.ndarray:
        return ((levels - colors) ** 2 / (sd**2 + (SETTINGS.shade * colors) ** 2)).mean(axis=-1)

    core, behind = np.median(median[inside], axis=0), np.median(median[ring], axis=0)

    def score(at: np.ndarray) -> tuple[float, float]:
        x, y = (int(n) for n in at)
        part = smooth[y - half : y + half + 1, x - half : x + half + 1]
        own, ground = apart(part, median)[inside], apart(part, behind)[inside]
        each = np.where(own < 1.0, 1.0 - own, np.where(ground < 1.0, -1.0, -SETTINGS.occluded_cost))
        around = np.maximum(1.0 - apart(part, core)[ring], -1.0)
        return each.mean() - SETTINGS.ring_weight * around.mean(), (own < 1.0).mean()

    # views are redrawn in whole levels, between pixels to a 32nd of one
    assert at_there.score == pytest.approx(score(there)[0], abs=0.01)
    best = score(np.rint(place.center_px))
    assert (place.score, place.share) == pytest.approx(best, abs=0.01)
    off_px = np.rint(place.center_px) - (101.0, 79.0)
    assert place.weighed == pytest.approx(place.score - SETTINGS.prior * float(off_px @ off_px) / 9.0, abs=1e-9)
