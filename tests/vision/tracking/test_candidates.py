"""Places that look like a mark, taken as marks: against closed forms, and places drawn."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from vision import Detection, Disc, Expected, Lighting, Outline, draw_frame
from vision.tracking.appearance import AppearanceMatch
from vision.tracking.candidates import detection_at, detection_in_other_light, fused, is_mark, is_mark_in_other_light
from vision.tracking.settings import FINDER

SETTINGS = FINDER.candidates
RADIUS, AT = 9.0, np.array([100.0, 80.0])
ONE = Expected("M1", AT, 9.0 * np.eye(2), 0.0, Outline(RADIUS * np.eye(2), 0.05))
PLACE = AppearanceMatch(AT, score=1.3, share=0.95, around=-0.8, color_bgr=(30.0, 30.0, 150.0), weighed=1.25)


def test_a_centre_by_outline_and_a_place_make_the_mean_of_least_variance() -> None:
    cov = np.array([[0.3, 0.1], [0.1, 0.2]])
    seen = Detection(AT + np.array([0.6, -0.4]), cov, 250.0, 0.0, False, color_bgr=(1.0, 2.0, 3.0))
    both = fused(seen, PLACE)
    of_place = detection_at(PLACE, ONE).cov_px2
    information = np.linalg.inv(cov) + np.linalg.inv(of_place)
    mean = np.linalg.solve(information, np.linalg.solve(cov, seen.center_px) + np.linalg.solve(of_place, AT))
    np.testing.assert_allclose(both.center_px, mean, atol=1e-9)
    np.testing.assert_allclose(both.cov_px2, SETTINGS.shared * np.linalg.inv(information), atol=1e-12)
    assert (both.area_px, both.occluded, both.color_bgr) == (250.0, False, (1.0, 2.0, 3.0))


def test_a_place_is_the_less_sure_the_less_it_looks_like_the_mark() -> None:
    sds = [
        detection_at(replace(PLACE, score=score), ONE).cov_px2[0, 0] ** 0.5 for score in (1.5, 1.35, 1.2, 1.0, 0.8, 0.3)
    ]
    assert sds[:2] == [SETTINGS.min_sd_px, SETTINGS.min_sd_px]
    assert sds[-1] == SETTINGS.max_sd_px
    assert all(a < b for a, b in pairwise(sds[1:]))


@pytest.mark.parametrize(
    ("change", "distance", "accepted"),
    [
        ({}, 0.5, True),
        ({"score": 0.56}, 1.0, True),
        ({"score": 0.54}, 0.0, False),
        ({"share": 0.71}, 0.5, True),
        ({"share": 0.69}, 0.5, False),
        ({"share": 0.69, "around": -0.89}, 0.5, False),
        ({"share": 0.31, "around": -0.91}, 0.5, True),
        ({"share": 0.29, "around": -0.91}, 0.5, False),
        ({"score": 0.54, "around": -0.91}, 0.5, False),
        ({"score": 1.25}, 1.5, True),
        ({"score": 1.22}, 1.5, False),
        ({"score": 1.49}, 2.8, False),
    ],
)
def test_a_missed_mark_must_look_like_it(change: dict[str, float], distance: float, accepted: bool) -> None:
    assert is_mark(replace(PLACE, **change), distance) is accepted


@pytest.mark.parametrize(
    ("change", "distance", "accepted"),
    [
        ({}, 0.5, True),
        ({"weighed": 0.76}, 1.0, True),
        ({"weighed": 0.74}, 0.0, False),
        ({"share": 0.71}, 0.5, True),
        ({"share": 0.69}, 0.5, False),
        ({"around": -0.21}, 0.5, True),
        ({"around": -0.19}, 0.5, False),
        ({"share": 0.31, "around": -0.91, "score": 0.76, "weighed": 0.1}, 0.5, True),
        ({"share": 0.31, "around": -0.91, "score": 0.74}, 0.5, False),
        ({"share": 0.29, "around": -0.91}, 0.5, False),
        ({"weighed": 1.10}, 1.2, True),
        ({"weighed": 1.06}, 1.2, False),
        ({"score": 1.10, "around": -0.91}, 1.2, True),
        ({"score": 1.06, "around": -0.91}, 1.2, False),
    ],
)
def test_in_other_light_a_mark_must_be_even_and_apart(change, distance, accepted):
    assert is_mark_in_other_light(replace(PLACE, **change), distance) is accepted


def test_a_place_goes_half_the_way_to_its_rim_and_is_less_sure_the_further_that_is() -> None:
    picture = draw_frame((200, 160), [Disc(AT, (RADIUS, RADIUS), 0.0)], Lighting(), np.random.default_rng(1))
    variances = []
    for off in (0.0, 1.0, 2.0):
        place = replace(PLACE, center_px=AT + np.array([off, 0.0]))
        seen = detection_in_other_light(picture, place, ONE)
        np.testing.assert_allclose(seen.center_px, AT + np.array([off / 2.0, 0.0]), atol=0.1)
        variances.append(seen.cov_px2[0, 0])
    assert variances[0] < variances[1] < variances[2]
    far = replace(PLACE, center_px=AT + np.array([5.0, 0.0]))
    np.testing.assert_allclose(detection_in_other_light(picture, far, ONE).center_px, far.center_px)
