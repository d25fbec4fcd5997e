"""Regions of a picture in which marks are searched."""

import numpy as np

from vision import Expected, Outline
from vision.tracking.regions import search_regions
from vision.tracking.settings import FINDER


def one(name: str, u: float, v: float, hue_deg: float = 0.0) -> Expected:
    return Expected(name, np.array([u, v]), np.eye(2), hue_deg, Outline(5.0 * np.eye(2)))


def test_regions_of_one_hue_that_overlap_are_one() -> None:
    """The first and the third overlap only with the second; a region reaches 23 px from a mark, by its settings."""
    marks = [one("a", 100.0, 100.0), one("c", 160.0, 100.0), one("b", 130.0, 100.0), one("other", 130.0, 100.0, 120.0)]
    (box, own), (other_box, other) = search_regions(marks, (200, 300), FINDER)
    assert {mark.name for mark in own} == {"a", "b", "c"}
    assert [mark.name for mark in other] == ["other"]
    assert box == (77, 77, 107, 47)
    assert other_box == (107, 77, 47, 47)


def test_a_mark_outside_the_picture_is_searched_for_as_far_as_its_region_reaches() -> None:
    regions = search_regions([one("near", -10.0, 100.0), one("far", -40.0, 100.0)], (200, 300), FINDER)
    assert regions == [((0, 77, 14, 47), [])]
