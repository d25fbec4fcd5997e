"""Marks followed in the picture alone."""

import numpy as np

from experiments.studies.px_follower import PxFollower
from vision import Disc, Frame, Lighting, MarkHue, Outline, draw_frame


def test_two_marks_that_cross_are_followed_to_their_ends() -> None:
    rng = np.random.default_rng(1)
    hue, outline = MarkHue(0.0), Outline(10.0 * np.eye(2), 0.05)
    starts = {"a": np.array([100.0, 200.0]), "b": np.array([420.0, 205.0])}
    follower = PxFollower(dict.fromkeys(starts, hue), 100.0, starts)
    for k in range(70):
        places = {"a": starts["a"] + (4.5 * k, 0.0), "b": starts["b"] - (4.5 * k, 0.0)}
        image = draw_frame((540, 400), [Disc(p, (10.0, 10.0), 0.0) for p in places.values()], Lighting(), rng)
        found = follower.see(Frame(k, k / 30.0, image), dict.fromkeys(starts, outline))
    assert np.abs(found["a"].center_px - places["a"]).max() < 0.2
    assert np.abs(found["b"].center_px - places["b"]).max() < 0.2


def test_a_mark_out_of_view_is_not_found_and_found_again() -> None:
    rng = np.random.default_rng(2)
    follower = PxFollower({"a": MarkHue(0.0)}, 500.0)
    outline = {"a": Outline(10.0 * np.eye(2), 0.05)}
    seen = []
    for k in range(40):
        discs = [] if 10 <= k < 25 else [Disc(np.array([100.0 + 2.0 * k, 150.0]), (10.0, 10.0), 0.0)]
        seen.append("a" in follower.see(Frame(k, k / 30.0, draw_frame((320, 240), discs, Lighting(), rng)), outline))
    assert seen == [not 10 <= k < 25 for k in range(40)]
