"""Marks partly covered or missing, compared with how they looked: found on blood, left out where a hand hides them."""

from dataclasses import replace

import numpy as np

from vision import Disc, Expected, Lighting, MarkFinder, MarkHue, Outline, draw_frame
from vision.tracking.settings import FINDER, FinderSettings

SIZE, RADIUS = (400, 300), 9.0
HOMES = {"M1": (90.0, 80.0), "M2": (300.0, 90.0), "M3": (200.0, 220.0)}
BLOOD = {"hue_deg": 0.0, "saturation": 0.9, "value": 0.45}
SKIN = {"hue_deg": 12.0, "saturation": 0.55, "value": 0.6}


def expected(rng: np.random.Generator, places: dict[str, tuple[float, float]], hue_deg: float = 0.0) -> list[Expected]:
    outline = Outline(RADIUS * np.eye(2), 0.05)
    return [
        Expected(name, np.array(at) + rng.normal(0.0, 3.0, 2), 9.0 * np.eye(2), hue_deg, outline)
        for name, at in places.items()
    ]


def frame(rng: np.random.Generator, under: list[Disc], over: list[Disc] | None = None) -> np.ndarray:
    marks = [Disc(np.array(at), (RADIUS, RADIUS), 0.0) for at in HOMES.values()]
    return draw_frame(SIZE, [*under, *marks, *(over or [])], Lighting(), rng)


def warmed(rng: np.random.Generator, n: int = 5, settings: FinderSettings = FINDER) -> MarkFinder:
    finder = MarkFinder([MarkHue(0.0)], settings)
    for _ in range(n):
        assert len(finder.find(frame(rng, []), expected(rng, HOMES))) == len(HOMES)
    return finder


def test_a_mark_that_slides_over_blood_is_still_found_at_its_place() -> None:
    rng = np.random.default_rng(1)
    finder, off = warmed(rng), []
    for k in range(20):
        at = np.array(HOMES["M1"])
        blood = Disc(at + np.array([40.0 - 4.0 * k, 6.0]), (26.0, 20.0), **BLOOD)
        found = {f.name: f.detection for f in finder.find(frame(rng, [blood]), expected(rng, HOMES))}
        assert found.keys() == HOMES.keys(), k
        off.append((found["M1"].center_px - at) / np.sqrt(np.diag(found["M1"].cov_px2)))
        assert np.abs(found["M1"].center_px - at).max() < 2.0, k
    assert np.sqrt(np.mean(np.square(off))) < 1.5


def test_a_mark_that_was_on_blood_from_the_start_is_found_as_another_of_its_kind() -> None:
    rng = np.random.default_rng(6)
    finder, off = MarkFinder([MarkHue(0.0)]), []
    at = np.array(HOMES["M2"])
    blood = Disc(at + np.array([9.0, -4.0]), (30.0, 22.0), **BLOOD)
    larger = Outline(13.0 * np.eye(2), 0.05)
    paler = Disc(at, (13.0, 13.0), 0.0, saturation=0.65, value=0.75)
    for _ in range(10):
        places = [replace(one, outline=larger) if one.name == "M2" else one for one in expected(rng, HOMES)]
        found = {f.name: f.detection for f in finder.find(frame(rng, [blood], [paler]), places)}
        if "M2" in found:
            off.append((found["M2"].center_px - at) / np.sqrt(np.diag(found["M2"].cov_px2)))
    assert len(off) >= 9
    assert np.sqrt(np.mean(np.square(off))) < 1.5


def test_a_mark_behind_a_hand_is_not_named() -> None:
    rng = np.random.default_rng(2)
    finder = warmed(rng)
    for k in range(10):
        hand = Disc(np.array(HOMES["M2"]) + np.array([0.6 * k, 4.0]), (34.0, 26.0), **SKIN)
        found = {f.name for f in finder.find(frame(rng, [], [hand]), expected(rng, HOMES))}
        assert found == {"M1", "M3"}, k
    assert len(finder.find(frame(rng, []), expected(rng, HOMES))) == len(HOMES)


def test_a_blot_of_the_colour_where_a_mark_is_hidden_is_not_it() -> None:
    rng = np.random.default_rng(3)
    finder = warmed(rng)
    cover = Disc(np.array(HOMES["M3"]), (20.0, 20.0), 120.0, saturation=0.1, value=0.8)
    for angle in np.linspace(0.0, 6.0, 12):
        beside = np.array(HOMES["M3"]) + 7.0 * np.array([np.cos(angle), np.sin(angle)])
        blot = Disc(beside, (2.5, 7.0), 0.0, value=0.5)
        found = {f.name for f in finder.find(frame(rng, [], [cover, blot]), expected(rng, HOMES))}
        assert found == {"M1", "M2"}


def test_looks_are_forgotten_where_a_mark_is_not_seen_for_long() -> None:
    rng = np.random.default_rng(4)
    finder = warmed(rng, settings=replace(FINDER, templates=replace(FINDER.templates, forget=15)))
    others = {name: at for name, at in HOMES.items() if name != "M2"}
    cover = Disc(np.array(HOMES["M2"]), (30.0, 30.0), 120.0, saturation=0.02, value=0.8)
    hidden = frame(rng, [], [cover])
    for _ in range(15):
        assert "M2" in finder.templates
        finder.find(hidden, expected(rng, HOMES))
    assert "M2" not in finder.templates
    assert all(name in finder.templates for name in others)


def test_looks_of_another_hue_are_not_lent() -> None:
    rng = np.random.default_rng(5)
    finder = MarkFinder([MarkHue(0.0), MarkHue(120.0)])
    for _ in range(5):
        finder.find(frame(rng, []), expected(rng, HOMES))
    blood = Disc(np.array([140.0, 150.0]), (30.0, 24.0), **BLOOD)
    red = Disc(np.array([130.0, 150.0]), (RADIUS, RADIUS), 0.0)
    picture = frame(rng, [blood, red])
    green = expected(rng, {"G": (130.0, 150.0)}, 120.0)
    assert "G" not in {f.name for f in finder.find(picture, [*expected(rng, HOMES), *green])}
    same = expected(rng, {"R": (130.0, 150.0)})
    assert "R" in {f.name for f in finder.find(picture, [*expected(rng, HOMES), *same])}
