"""The overlay: drawn where the projection says, in the colours that mean it, and legible."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from experiments.film.overlay import LIGHT, TARGET, Fate, MarkDrawn, NeedleDrawn, Overlay, drawn, hue_colour, scale_of
from experiments.film.strokes import clipped, dashed, draw_text, ellipse_points

GREY = np.full((480, 640, 3), 128, np.uint8)
ROOT_95 = 5.991464547107979**0.5  # of the chi-square distribution, 2 degrees of freedom, from a table
FAR_AWAY = np.array([500.0, 400.0])


def overlay(**changed: object) -> Overlay:
    """A network of one spring, no marks, the target out of the way."""
    plain = Overlay(
        status="TRACKING",
        status_colour=(115, 158, 0),
        facts="1.00 s",
        nodes_px=np.array([[100.0, 300.0], [200.0, 300.0]]),
        names=("A", ""),
        fixed=np.array([True, False]),
        springs=np.array([[0, 1]]),
        marks=(),
        target_px=FAR_AWAY,
        target_cov_px2=np.diag([100.0, 25.0]),
        target_shape_px=2.0 * np.eye(2),
        trusted=True,
    )
    return replace(plain, **changed)


def mark(fate: Fate, **changed: object) -> MarkDrawn:
    return replace(
        MarkDrawn(
            "M1",
            120.0,
            fate,
            12.0 * np.eye(2),
            center_px=None if fate is Fate.LOST else np.array([300.0, 200.0]),
            cov_px2=None if fate is Fate.LOST else np.diag([16.0, 4.0]),
            expected_px=np.array([310.0, 200.0]),
            expected_cov_px2=400.0 * np.eye(2),
        ),
        **changed,
    )


def near(picture: np.ndarray, place: tuple[float, float], colour: tuple[int, int, int], reach: int = 1) -> bool:
    """Whether a pixel within reach of a place has about this colour."""
    u, v = round(place[0]), round(place[1])
    part = picture[v - reach : v + reach + 1, u - reach : u + reach + 1].astype(int)
    return bool((np.abs(part - colour).max(axis=2) < 60).any())


def test_the_targets_ellipse_holds_95_percent_and_its_axes_are_those_of_the_covariance() -> None:
    along, across = np.array([np.cos(0.5), np.sin(0.5)]), np.array([-np.sin(0.5), np.cos(0.5)])
    picture = drawn(GREY, overlay(target_cov_px2=900.0 * np.outer(along, along) + 180.0 * np.outer(across, across)))
    assert (GREY == 128).all()
    for way in (ROOT_95 * 30.0 * along, ROOT_95 * 180.0**0.5 * across):
        assert near(picture, tuple(FAR_AWAY + way), TARGET)
        assert near(picture, tuple(FAR_AWAY - way), TARGET)
        assert not near(picture, tuple(FAR_AWAY + 0.9 * way), TARGET)


def test_an_ellipse_that_is_not_to_be_relied_upon_is_faint() -> None:
    place = (int(FAR_AWAY[0] + ROOT_95 * 10.0), int(FAR_AWAY[1]))
    sure, faint = (drawn(GREY, overlay(trusted=trusted)) for trusted in (True, False))
    away = [np.abs(picture[place[1], place[0] - 1 : place[0] + 2].astype(int) - 128).max() for picture in (sure, faint)]
    assert away[0] > 90
    assert 15 < away[1] < 0.5 * away[0]


@pytest.mark.parametrize("sd", [1e4, 1e8, 1e150, np.inf, np.nan])
def test_an_ellipse_larger_than_the_picture_is_clipped(sd: float) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        picture = drawn(GREY, overlay(target_cov_px2=sd**2 * np.eye(2)))
    assert picture.shape == GREY.shape
    assert near(picture, tuple(FAR_AWAY), TARGET, 3)  # the target itself is there


def test_a_found_mark_has_its_circle_and_ellipse_in_its_hue() -> None:
    picture, green = drawn(GREY, overlay(marks=(mark(Fate.FOUND),))), hue_colour(120.0)
    assert green[1] > 2 * max(green[0], green[2])
    for u, v in ((12.0, 0.0), (0.0, 12.0), (0.0, -12.0), (-ROOT_95 * 4.0, 0.0), (0.0, ROOT_95 * 2.0)):
        assert near(picture, (300.0 + u, 200.0 + v), green), (u, v)
    assert not near(picture, (300.0 - 12.0 * 0.7 * 1.2, 200.0 - 12.0 * 0.7 * 1.2), LIGHT)


def test_a_refused_mark_is_crossed() -> None:
    picture = drawn(GREY, overlay(marks=(mark(Fate.REFUSED, why="5 sigma"),)))
    corner = 12.0 * 1.1
    for u, v in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        assert near(picture, (300.0 + u * corner, 200.0 + v * corner), LIGHT)


def test_a_lost_mark_is_dashed_where_it_was_expected_and_its_candidate_crossed() -> None:
    one = mark(Fate.LOST, why="too few pixels", candidate_px=np.array([400.0, 250.0]))
    picture, green = drawn(GREY, overlay(marks=(one,))), hue_colour(120.0)
    around = [(310.0 + 12.0 * np.cos(a), 200.0 + 12.0 * np.sin(a)) for a in np.linspace(0.0, 2.0 * np.pi, 60)]
    on = [near(picture, place, green, 0) for place in around]
    assert 10 < sum(on) < 50  # dashes, and gaps between them
    assert near(picture, (400.0, 250.0), green)
    assert not (picture[190:210, 280:292].astype(int) - 128).any()  # nothing is drawn where it was not
    foot = picture[455:]
    assert (foot > 200).any()  # the reason stands at the lower edge


def test_springs_nodes_and_names_are_where_the_nodes_are() -> None:
    picture = drawn(GREY, overlay())
    assert near(picture, (150.0, 300.0), (215, 215, 215))
    assert not near(picture, (230.0, 300.0), (215, 215, 215))
    assert (picture[275:298, 104:125] > 200).any()  # A, to the upper right of its node
    assert not (picture[275:295, 204:225] > 200).any()


def test_a_node_that_is_not_seen_is_left_out() -> None:
    lost = np.array([[100.0, 300.0], [np.nan, np.nan]])
    picture = drawn(GREY, overlay(nodes_px=lost))
    assert not near(picture, (150.0, 300.0), (215, 215, 215))
    assert near(picture, (102.0, 300.0), (215, 215, 215), 2)


def test_the_status_stands_on_a_plate_of_its_colour() -> None:
    picture = drawn(GREY, overlay())
    assert near(picture, (8.0, 8.0), (115, 158, 0))
    assert not near(drawn(GREY, overlay(status_colour=(0, 94, 213))), (8.0, 8.0), (115, 158, 0))


def test_the_needle_goes_from_its_entry_to_its_tip_and_dashed_to_the_aim() -> None:
    needle = NeedleDrawn(
        np.array([[400.0, 100.0], [400.0, 150.0]]), np.array([[400.0, 150.0], [400.0, 220.0]]), np.array([400.0, 240.0])
    )
    picture = drawn(GREY, overlay(needle=needle, advice="GO 93 %: now", advice_colour=(115, 158, 0)))
    assert near(picture, (400.0, 125.0), LIGHT, 0)
    ahead = [near(picture, (400.0, v), LIGHT, 0) for v in range(152, 218)]
    assert 20 < sum(ahead) < 50
    assert near(picture, (404.0, 244.0), LIGHT)
    assert not (picture[230:250, 380:390].astype(int) - 128).any()


def test_letters_are_dark_edged_so_that_they_are_read_on_white_and_on_black() -> None:
    for level in (0, 255):
        image = np.full((60, 200, 3), level, np.uint8)
        width = draw_text(image, "M3 lost", (10.0, 20.0), LIGHT, 1.0)
        assert 20 < width < 150
        assert (image[20:45, 10:150] > 230).any()
        assert (image[20:45, 10:150] < 25).any()


def test_text_at_the_border_is_moved_into_the_picture() -> None:
    image = np.zeros((60, 200, 3), np.uint8)
    draw_text(image, "M3", (195.0, 55.0), LIGHT, 1.0)
    assert (image[30:, 150:] > 200).any()


def test_lines_and_letters_grow_with_the_picture() -> None:
    large = np.full((1080, 1920, 3), 128, np.uint8)
    assert scale_of(GREY) == 1.0
    assert scale_of(large) == pytest.approx(2.25)
    assert scale_of(np.zeros((100, 100, 3), np.uint8)) == 1.0
    rows = [np.flatnonzero((drawn(image, overlay())[:, 9] != 128).any(axis=1)).max() for image in (GREY, large)]
    assert rows[1] > 1.8 * rows[0]


def test_many_reasons_do_not_hide_the_picture() -> None:
    marks = tuple(mark(Fate.LOST, name=f"N{k}", why="too few pixels of hue 120 ± 18") for k in range(40))
    picture = drawn(GREY, overlay(marks=marks))
    assert (picture[300, 600:] == 128).all()


def test_segments_are_cut_at_the_picture_and_keep_their_direction() -> None:
    (one,) = clipped(np.array([[[-1e9, -1e9 + 100.0], [1e9, 1e9 + 100.0]]]), (640, 480))
    assert np.abs((one[1] - one[0]) / np.linalg.norm(one[1] - one[0]) - np.sqrt(0.5)).max() < 1e-6
    assert np.abs(one).max() < 700.0
    assert np.abs(one[:, 1] - one[:, 0] - 100.0).max() < 1e-3  # still v = u + 100
    outside = np.array([[[-50.0, 700.0], [900.0, 700.0]], [[-90.0, 10.0], [-50.0, 10.0]]])
    assert len(clipped(outside, (640, 480))) == 0


def test_dashes_cover_half_of_a_line() -> None:
    pieces = dashed(np.array([[0.0, 0.0], [100.0, 0.0]]), 5.0)
    assert len(pieces) == 10
    assert np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1).sum() == pytest.approx(50.0)
    circle = ellipse_points(np.zeros(2), 3.0 * np.eye(2))
    assert np.linalg.norm(circle, axis=1) == pytest.approx(3.0)
    assert cv2.contourArea(circle.astype(np.float32)) == pytest.approx(9.0 * np.pi, rel=0.02)
