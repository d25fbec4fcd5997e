"""ABORT: only of a needle that is inside, in place of no guidance or after GO, and without flicker."""

from dataclasses import replace

import numpy as np
import pytest

from estimators import AbortWatch, Advice, AdviceSettings, Guidance, Insertion
from tests.estimators.guidance.straight_down import DOWN

SETTINGS = AdviceSettings(go=0.8, abort=0.5, abort_s=0.5)
GO = Guidance(Advice.GO, "a hit is 90 % probable", probability=0.9)
WAIT = Guidance(Advice.WAIT, "wait", probability=0.6)
POOR = Guidance(Advice.REALIGN, "turned by 9.0 deg a hit is 90 % probable, now 39 %", probability=0.39)
NONE = Guidance(Advice.NO_GUIDANCE, "the estimate is LOST")
INSIDE = replace(DOWN, depth_m=1e-3)


def given(steps, watch=None):
    """The advices of a watch that is asked 10 times a second, of pairs of insertion and guidance."""
    watch = AbortWatch() if watch is None else watch
    return [watch.checked(one, where, SETTINGS, 0.1 * k) for k, (where, one) in enumerate(steps)]


@pytest.mark.parametrize("one", [GO, WAIT, POOR, NONE])
def test_outside_nothing_is_changed(one):
    assert given([(DOWN, GO), (DOWN, one)]) == [GO, one]


def test_inside_no_guidance_is_abort_and_says_what_to_do_and_why():
    (said,) = given([(INSIDE, NONE)])
    assert said.advice is Advice.ABORT
    assert said.reason == "stop: draw back, or wait for new advice; the estimate is LOST"


def test_after_go_a_hit_less_than_half_as_probable_as_go_asks_is_abort():
    """0.5 of 0.8: 0.40 is none yet, 0.39 is; a needle that never arrives has no probability."""
    never = Guidance(Advice.WAIT, "the needle does not reach the target within 3.0 s")
    just = replace(POOR, probability=0.4)
    said = given([(DOWN, GO), (INSIDE, just), (INSIDE, POOR)])
    assert [one.advice for one in said] == [Advice.GO, Advice.REALIGN, Advice.ABORT]
    assert said[2].reason == f"stop: draw back, or wait for GO; {POOR.reason}"
    assert said[2].probability == 0.39
    assert given([(INSIDE, GO), (INSIDE, never)])[1].advice is Advice.ABORT


def test_a_needle_that_was_never_advised_to_go_is_not_aborted_for_its_probability():
    assert given([(INSIDE, POOR), (INSIDE, WAIT)]) == [POOR, WAIT]


def test_drawn_out_it_restarts():
    said = given([(DOWN, GO), (INSIDE, POOR), (DOWN, POOR), (DOWN, GO), (INSIDE, WAIT)])
    assert [one.advice for one in said] == [Advice.GO, Advice.ABORT, Advice.REALIGN, Advice.GO, Advice.WAIT]


def test_a_needle_that_goes_in_before_go_is_aborted_until_it_is_out_or_go_was_given_for_half_a_second():
    """GO before it was last out does not count, nor does one of half a second ago, or that comes as it goes in."""
    said = given([(DOWN, POOR), (INSIDE, POOR), (INSIDE, WAIT), (DOWN, WAIT)])
    assert [one.advice for one in said] == [Advice.REALIGN, Advice.ABORT, Advice.ABORT, Advice.WAIT]
    assert said[1].reason == f"stop: draw back, or wait for GO; it went in before GO; {POOR.reason}"
    late = given([(DOWN, GO), *[(DOWN, WAIT)] * 5, (INSIDE, WAIT)])
    assert late[-1].advice is Advice.ABORT
    in_time = given([(DOWN, GO), *[(DOWN, WAIT)] * 4, (INSIDE, WAIT)])
    assert in_time[-1].advice is Advice.WAIT
    again = given([(DOWN, GO), (INSIDE, GO), (DOWN, WAIT), *[(INSIDE, GO)] * 6])
    assert [one.advice for one in again] == [Advice.GO, Advice.GO, Advice.WAIT, *[Advice.ABORT] * 5, Advice.GO]


def test_abort_stays_until_go_was_given_for_half_a_second():
    """Frames that come and go, and probabilities about the threshold, do not make it flicker."""
    steps = [GO, NONE, GO, GO, NONE, GO, WAIT, GO, *[GO] * 5]
    said = given([(INSIDE, one) for one in steps])
    assert [one.advice for one in said] == [Advice.GO, *[Advice.ABORT] * 11, Advice.GO]
    assert said[2].reason == "stop: draw back, or wait for GO; well again for 0.0 s, not yet for 0.5 s"


def test_without_a_go_any_guidance_for_half_a_second_ends_it():
    said = given([(INSIDE, NONE), *[(INSIDE, POOR)] * 6])
    assert [one.advice for one in said] == [*[Advice.ABORT] * 6, Advice.REALIGN]


@pytest.mark.parametrize(
    ("tip", "axis", "depth_m"),
    [
        ([0.0, 0.11], [0.0, -2.0], 0.0),
        ([0.0, 0.1], [0.0, -1.0], 0.0),
        ([0.0, 0.07], [0.0, -1.0], 0.03),
        ([0.04, 0.07], [0.8, -0.6], 0.05),
        ([0.0, 0.07], [1.0, 0.0], 0.06),
        ([0.0, 0.07], [0.0, 1.0], 0.06),
    ],
)
def test_a_tracked_needle_is_as_deep_as_it_is_below_the_skin_along_its_line(tip, axis, depth_m):
    """The skin is y = 0.1 m; 30 mm below it at cos 0.6 are 50 mm, and never more than at 60 degrees."""
    found = DOWN.tracked(np.array(tip), np.array(axis))
    assert isinstance(found, Insertion)
    assert found.depth_m == pytest.approx(depth_m, abs=1e-12)
    np.testing.assert_allclose(found.entry + found.depth_m * found.axis, tip, atol=1e-12)
    np.testing.assert_allclose(found.axis, np.array(axis) / np.linalg.norm(axis))
    assert found.speed_m_s == DOWN.speed_m_s
