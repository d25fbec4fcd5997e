"""The sheet of the worst frames: which frame of a kind is kept, which kinds stand on it and in which order."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from experiments.film.overlay import Fate, MarkDrawn, Overlay
from experiments.film.worst import MOST_TILES, TILE_PX, WorstFrames
from tests.experiments.film.test_overlay import overlay as plain

HEIGHT, WIDTH = 60, 80


def overlay(status: str, *missed: MarkDrawn, sd_px: float = 1.0) -> Overlay:
    found = MarkDrawn("M1", 0.0, Fate.FOUND, np.eye(2))
    return plain(status=status, marks=(found, *missed), target_cov_px2=sd_px**2 / 2.0 * np.eye(2))


def lost(name: str, why: str, *, measured: bool = True) -> MarkDrawn:
    return MarkDrawn(name, 0.0, Fate.LOST, np.eye(2), why=why, measured=measured)


def picture(grey: int, width: int = WIDTH) -> np.ndarray:
    return np.full((HEIGHT * width // WIDTH, width, 3), grey, dtype=np.uint8)


def sheet_of(frames: Iterable[tuple[Overlay, np.ndarray]]) -> np.ndarray:
    worst = WorstFrames()
    for one, image in frames:
        worst.take(one, image)
    sheet = worst.sheet()
    assert sheet is not None
    return sheet


def greys(sheet: np.ndarray, n: int, width: int = WIDTH) -> list[int]:
    """The grey of each still on a sheet, row by row, by a pixel in its lowest row."""
    rows = -(-n // 2)
    tall = sheet.shape[0] // rows
    return [int(sheet[(k // 2 + 1) * tall - 1, k % 2 * width + width // 2, 0]) for k in range(n)]


def test_of_a_kind_the_frame_with_most_marks_missing_is_kept_then_the_least_certain() -> None:
    """Reasons that differ in their numbers alone are one kind; a mark for scoring only is none of the missing."""
    frames = [
        (overlay("TRACKING", lost("M3", "too few pixels (9 px)"), sd_px=9.0), 10),
        (overlay("TRACKING", lost("M3", "too few pixels (8 px)"), lost("M4", "too few pixels (7 px)")), 20),
        (overlay("TRACKING", lost("M3", "too few pixels"), lost("M4", "wrong shape"), sd_px=5.0), 30),
        (overlay("TRACKING", lost("M3", "too few pixels"), lost("M2", "wrong shape", measured=False), sd_px=99.0), 40),
    ]
    sheet = sheet_of((one, picture(grey)) for one, grey in frames)
    assert sheet.shape[1] == WIDTH
    assert greys(sheet, 1) == [30]


def test_the_worst_status_comes_first_then_the_most_frequent_kind() -> None:
    """Frames in which nothing was amiss, and those of a start, are not on the sheet."""
    kinds = [
        (overlay("TRACKING"), 10, 9),
        (overlay("INITIALISING", lost("M3", "too few pixels")), 20, 9),
        (overlay("TRACKING", lost("M3", "wrong size")), 30, 1),
        (overlay("TRACKING", lost("M4", "wrong shape")), 40, 2),
        (overlay("COASTING", lost("M4", "wrong shape")), 50, 1),
        (overlay("LOST"), 60, 1),
    ]
    sheet = sheet_of((one, picture(grey)) for one, grey, n in kinds for _ in range(n))
    assert greys(sheet, 4) == [60, 50, 40, 30]


def test_where_nothing_was_amiss_the_least_certain_frame_is_shown() -> None:
    assert WorstFrames().sheet() is None
    frames = ((1.0, 10), (3.0, 20), (2.0, 30))
    assert greys(sheet_of((overlay("TRACKING", sd_px=sd_px), picture(grey)) for sd_px, grey in frames), 1) == [20]


@pytest.mark.parametrize("n", [3, MOST_TILES + 3])
def test_a_sheet_has_two_stills_a_row_no_wider_than_a_tile_and_no_more_than_can_be_read(n: int) -> None:
    reasons = [overlay("LOST", lost("M3", f"reason {chr(97 + k)}")) for k in range(n)]
    sheet = sheet_of((one, picture(100 + k, 2 * TILE_PX)) for k, one in enumerate(reasons))
    assert sheet.shape[1] == 2 * TILE_PX
    n_rows = -(-min(n, MOST_TILES) // 2)
    assert HEIGHT * TILE_PX // WIDTH < sheet.shape[0] / n_rows < HEIGHT * TILE_PX // WIDTH + 60


def test_pictures_of_cameras_of_different_sizes_stand_on_one_sheet() -> None:
    sheet = sheet_of([(overlay("LOST"), picture(40)), (overlay("COASTING"), picture(50, WIDTH // 2))])
    assert sheet.shape[1] == 2 * WIDTH
    assert [int(sheet[-1, column, 0]) for column in (0, WIDTH, 2 * WIDTH - 1)] == [40, 50, 0]


def test_a_camera_that_does_not_see_the_target_is_not_the_least_certain() -> None:
    outside = replace(overlay("TRACKING"), target_px=np.full(2, np.nan), target_cov_px2=None)
    assert greys(sheet_of([(overlay("TRACKING"), picture(10)), (outside, picture(20))]), 1) == [10]
