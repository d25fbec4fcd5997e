"""Advice on a needle: closed-form ways of the target, and every reason to give no guidance."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from estimators import (
    Advice,
    AdviceSettings,
    GaussianMixture,
    Hit,
    Insertion,
    Lesion,
    Needle,
    Status,
    TargetPath,
    advise,
    guide,
    hit_probability,
    path_times,
)
from estimators.guidance.advice import RULES, Prospect, decide
from tests.estimators.guidance.straight_down import DISC, DOWN, HEALTHY, NOW_S, TIP, at, path_of


class Filter:
    """A filter that must not be asked for a path, for its estimate is not healthy."""

    def __init__(self, seen_s):
        self.seen_s = seen_s

    def predict_path(self, times_s):
        pytest.fail("asked for a path in spite of the estimate's health")


FAULTS = {
    "lost": (replace(HEALTHY, status=Status.LOST), NOW_S, NOW_S, "the estimate is LOST"),
    "never seen": (HEALTHY, NOW_S, None, "no mark was seen for inf s"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_no_guidance_without_a_healthy_estimate(fault):
    """Only the reason is reported, and the path is not predicted."""
    estimate, now_s, seen_s, reason = FAULTS[fault]
    said = guide(Filter(seen_s), estimate, DOWN, DISC, needle=TIP, now_s=now_s)
    assert said.advice is Advice.NO_GUIDANCE
    assert reason in said.reason
    assert (said.probability, said.aim, said.arrival_s, said.best_in_s, said.outlook) == (None,) * 5


def test_go_at_a_target_that_rests_on_the_needles_line():
    """60 mm at 100 mm/s; the probability is that of the tip's and the target's covariances there."""
    said = advise(path_of(at(0.0, 0.04)), DOWN, DISC, needle=TIP)
    assert said.advice is Advice.GO
    assert said.arrival_s == pytest.approx(NOW_S + 0.6, abs=1e-6)
    assert said.depth_m == pytest.approx(0.06, abs=1e-9)
    assert said.lateral_m == pytest.approx(0.0, abs=1e-12)
    assert said.turn_rad == pytest.approx(0.0, abs=1e-9)
    target = GaussianMixture.gaussian(np.array([0.0, 0.04]), 1e-6 * np.eye(2))
    tip = GaussianMixture.gaussian(np.array([0.0, 0.04]), TIP.tip_cov(DOWN.axis, 0.06))
    assert said.probability == pytest.approx(hit_probability(target, tip, DOWN.axis, DISC, needle=TIP), abs=1e-9)
    np.testing.assert_allclose(said.aim, [0.0, 0.04], atol=1e-12)
    np.testing.assert_allclose(said.cov, 1e-6 * np.eye(2), rtol=1e-9)


def test_bending_across_the_needle_grows_with_depth():
    """Variances 0.3² mm² along it, and (0.01 60)² mm² more across."""
    np.testing.assert_allclose(1e6 * TIP.tip_cov(DOWN.axis, 0.06), np.diag([0.09 + 0.36, 0.09]), rtol=1e-12)


def test_the_target_is_met_where_it_will_be():
    """From 60 mm, coming nearer by 50 mm/s and aside by 20: met after 0.4 s, 40 mm deep and 8 mm aside."""
    said = advise(path_of(lambda t: np.c_[0.02 * t, 0.04 + 0.05 * t]), DOWN, DISC, needle=TIP)
    assert said.arrival_s == pytest.approx(NOW_S + 0.4, abs=1e-6)
    assert said.depth_m == pytest.approx(0.04, abs=1e-6)
    assert said.lateral_m == pytest.approx(0.008, abs=1e-6)


def test_the_notch_is_brought_to_the_target_and_not_the_tip():
    """5 + 20/2 mm further; the rest of the way is counted from where the tip stands already."""
    begun = replace(DOWN, depth_m=0.03)
    said = advise(path_of(at(0.0, 0.04)), begun, DISC, needle=Needle())
    assert said.depth_m == pytest.approx(0.045, abs=1e-9)
    assert said.arrival_s == pytest.approx(NOW_S + 0.45, abs=1e-6)


def test_turned_to_a_target_beside_the_line():
    """45 mm aside at 60 mm: by atan(3/4), and 75 mm deep."""
    said = advise(path_of(at(0.045, 0.04)), DOWN, DISC, needle=TIP)
    assert said.advice is Advice.REALIGN
    assert said.lateral_m == pytest.approx(0.045)
    assert said.turn_rad == pytest.approx(np.arctan(0.75), abs=1e-9)
    np.testing.assert_allclose(said.turned_axis, [0.6, -0.8], atol=1e-9)
    tip = GaussianMixture.gaussian(np.array([0.045, 0.04]), TIP.tip_cov(said.turned_axis, 0.075))
    target = GaussianMixture.gaussian(np.array([0.045, 0.04]), 1e-6 * np.eye(2))
    known = hit_probability(target, tip, said.turned_axis, DISC, needle=TIP)
    assert said.turned_probability == pytest.approx(known, abs=1e-9)
    assert f"turned by {np.degrees(np.arctan(0.75)):.1f} deg" in said.reason


def test_wait_for_a_target_that_swings_to_the_line():
    """Aside by 30 mm cos(2 pi t / 2.8 s), on the line at 0.7 s: 0.6 s of way, so one begins at 0.1 s."""
    said = advise(path_of(lambda t: np.c_[0.03 * np.cos(2 * np.pi * t / 2.8), 0.04 + 0 * t]), DOWN, DISC, needle=TIP)
    assert said.advice is Advice.WAIT
    assert said.best_in_s == pytest.approx(0.1, abs=1e-9)
    assert said.reason == "in 0.1 s a hit is 99 % probable, now 1 %"


def test_a_tip_that_is_too_deep_is_drawn_back():
    said = advise(path_of(at(0.0, 0.04)), replace(DOWN, depth_m=0.065), DISC, needle=TIP)
    assert said.advice is Advice.REALIGN
    assert said.depth_m == pytest.approx(-0.005, abs=1e-9)
    assert said.reason == "the tip is 5.0 mm too deep: draw it back"
    assert said.arrival_s == NOW_S
    assert said.probability < 0.4


@pytest.mark.parametrize("depth_m", [0.0, 0.02])
def test_a_target_behind_the_entry_is_not_before_the_needle(depth_m):
    """35 mm behind the entry of a needle that is not yet in, or a little: nothing is too deep."""
    said = advise(path_of(at(0.0, DOWN.entry[1] + 0.035)), replace(DOWN, depth_m=depth_m), DISC, needle=TIP)
    assert said.advice is Advice.REALIGN
    assert said.reason == "the target does not lie before the needle: turn it, or enter elsewhere"
    assert said.probability == pytest.approx(0.0, abs=1e-6)


def test_a_notch_that_is_to_go_less_deep_than_it_is_long_is_before_the_needle():
    """The target 1 mm below the entry, the notch's middle 15 mm behind a tip that is 20 mm deep: 4 mm too deep."""
    said = advise(path_of(at(0.0, DOWN.entry[1] - 1e-3)), replace(DOWN, depth_m=0.02), DISC, needle=Needle())
    assert said.reason == "the tip is 4.0 mm too deep: draw it back"


def test_wait_where_the_target_is_too_uncertain():
    """Sd 4 mm for a radius of 4 mm: at most 1 - exp(-1/2)."""
    said = advise(path_of(at(0.0, 0.04), sd=4e-3), DOWN, DISC, needle=replace(TIP, bending_sd=0.05))
    assert said.advice is Advice.WAIT
    # 5 % of a depth of 60 mm
    assert said.reason.endswith(
        f"on arrival the target is uncertain by 4 mm, the tip by {np.hypot(1e3 * TIP.tip_sd_m, 3.0):.2g} mm"
    )
    assert said.probability < 0.4


def test_wait_where_the_target_is_out_of_reach():
    """It flees at 200 mm/s from a needle of 100."""
    said = advise(path_of(lambda t: np.c_[0 * t, 0.04 - 0.2 * t]), DOWN, DISC, needle=TIP)
    assert said.advice is Advice.WAIT
    assert said.reason == "the needle does not reach the target within 4.0 s"
    assert (said.probability, said.best_in_s, said.best_probability) == (None, None, None)
    assert np.isinf(said.outlook.arrivals_s).all()


@pytest.mark.parametrize("speed_m_s", [1e-6, 1e-300])
def test_the_path_of_a_slow_needle_ends(speed_m_s):
    """The latest start is in 2 s, and no needle is followed for more than 30 s."""
    times = path_times(HEALTHY, replace(DOWN, speed_m_s=speed_m_s), TIP, AdviceSettings(), NOW_S)
    assert times[-1] == pytest.approx(NOW_S + 32.0, abs=0.1)


def test_a_part_of_the_needle_may_be_a_text():
    assert Needle(hit="TIP") == Needle(hit=Hit.TIP)
    assert Needle(hit="TIP").reach_m == 0.0


def test_a_gain_that_is_not_worth_it_is_not_waited_for():
    """The sd across, hence 2 Phi(r/s) - 1 for a core on a long lesion, shrinks: waited for only from `worth` on."""
    t = np.arange(121) / 30
    covs = np.zeros((121, 2, 2))
    covs[:, 0, 0] = np.where(t < 1.0, 2e-3, 1.6e-3) ** 2
    path = TargetPath(NOW_S + t, np.tile([0.0, 0.04], (121, 1)), covs)
    still = replace(TIP, tip_sd_m=0.0, bending_sd=0.0)
    lesion = Lesion(np.diag([4e-3, 1.0]))
    now, later = (2 * norm.cdf(4 / sd) - 1 for sd in (2.0, 1.6))
    for worth, what in ((later - now + 1e-3, Advice.GO), (later - now - 1e-3, Advice.WAIT)):
        said = advise(path, DOWN, lesion, needle=still, settings=AdviceSettings(worth=worth))
        assert (said.advice, said.probability) == (what, pytest.approx(now, abs=1e-4))
        assert said.best_probability == pytest.approx(later, abs=1e-4)


def test_in_space_it_is_the_same():
    """45 mm aside out of the plane: turned by atan(3/4)."""
    path = TargetPath(
        NOW_S + np.arange(121) / 30, np.tile([0.0, 0.04, 0.045], (121, 1)), np.tile(1e-6 * np.eye(3), (121, 1, 1))
    )
    down = Insertion(np.array([0.0, 0.1, 0.0]), np.array([0.0, -2.0, 0.0]), 0.1)
    said = advise(path, down, Lesion.ball(4e-3, 3), needle=TIP)
    assert said.advice is Advice.REALIGN
    np.testing.assert_allclose(said.turned_axis, [0.0, -0.8, 0.6], atol=1e-9)


SURE = Prospect(probability=0.95, arrives=True, reach_s=3.0, best_in_s=0.0, best_probability=0.95)
BY_RULE = {
    "never arrives": (replace(SURE, arrives=False, depth_m=-0.01), Advice.WAIT, "does not reach the target within 3.0"),
    "too deep": (replace(SURE, depth_m=-1.1e-3), Advice.REALIGN, "the tip is 1.1 mm too deep: draw it back"),
    "behind": (replace(SURE, behind=True, depth_m=-0.05), Advice.REALIGN, "does not lie before the needle: turn it"),
    "sure": (replace(SURE, depth_m=-1e-3), Advice.GO, "a hit is 95 % probable"),
    "just sure, hardly better later": (
        replace(SURE, probability=0.9, best_in_s=1.0, best_probability=0.95),
        Advice.GO,
        "a hit is 90 % probable",
    ),
    "better later": (
        replace(SURE, probability=0.9, best_in_s=1.0, best_probability=0.951),
        Advice.WAIT,
        "in 1.0 s a hit is 95 % probable, now 90 %",
    ),
    "sure later only": (
        replace(SURE, probability=0.899, best_in_s=0.4, best_probability=0.9, turned_probability=0.99),
        Advice.WAIT,
        "in 0.4 s a hit is 90 % probable, now 89 %",
    ),
    "sure once turned": (
        replace(SURE, probability=0.3, best_probability=0.8, turn_rad=0.1, turned_probability=0.9),
        Advice.REALIGN,
        "turned by 5.7 deg a hit is 90 % probable, now 30 %",
    ),
    "never sure": (
        replace(SURE, probability=0.3, best_probability=0.8, turn_rad=0.1, turned_probability=0.899),
        Advice.WAIT,
        "even well aimed a hit is 89 % probable",
    ),
    "never sure, worse turned": (
        replace(SURE, probability=0.5, best_probability=0.8, turned_probability=0.1, target_sd_m=3e-3, tip_sd_m=0.5e-3),
        Advice.WAIT,
        "even well aimed a hit is 50 % probable: on arrival the target is uncertain by 3 mm, the tip by 0.5 mm",
    ),
}


@pytest.mark.parametrize("case", BY_RULE)
def test_the_first_rule_that_holds_gives_the_advice(case):
    """Each threshold from either side, and its reason in words."""
    prospect, advice, reason = BY_RULE[case]
    found = decide(prospect, AdviceSettings())
    assert found[0] is advice
    assert reason in found[1]


def test_a_later_start_that_is_better_by_exactly_what_it_is_worth_is_not_waited_for():
    """In numbers without rounding."""
    settings = AdviceSettings(go=0.5, worth=0.25)
    equal = replace(SURE, probability=0.5, best_in_s=1.0, best_probability=0.75)
    assert decide(equal, settings)[0] is Advice.GO
    assert decide(replace(equal, best_probability=0.7501), settings)[0] is Advice.WAIT


def test_every_rule_is_reached_and_every_kind_of_advice_given():
    """NO_GUIDANCE is what `health_fault` gives, before the rules, and ABORT what `AbortWatch` does, after them."""
    first = [next(k for k, rule in enumerate(RULES) if rule.holds(p, AdviceSettings())) for p, _, _ in BY_RULE.values()]
    assert sorted(set(first)) == list(range(len(RULES)))
    assert {rule.advice for rule in RULES} == set(Advice) - {Advice.NO_GUIDANCE, Advice.ABORT}


def test_unknown_advice_and_prospects_without_a_rule_raise():
    with pytest.raises(ValueError, match="'STOP' is not a valid Advice"):
        Advice("STOP")
    with pytest.raises(LookupError, match="expected one of 6 rules to hold, found none for Prospect"):
        decide(replace(SURE, probability=0.1, best_probability=0.1), AdviceSettings(), RULES[:-1])


def test_advice_does_not_depend_on_where_the_origin_is():
    """Path and entry moved by metres: the same numbers to 1e-9, the aim moved with them."""
    shift = np.array([3.0, -5.0])
    path = path_of(lambda t: np.c_[0.02 * t, 0.04 + 0.05 * t])
    moved = replace(path, means=path.means + shift)
    here, there = (
        advise(p, replace(DOWN, entry=entry), DISC, needle=TIP)
        for p, entry in ((path, DOWN.entry), (moved, DOWN.entry + shift))
    )
    np.testing.assert_allclose(there.aim, here.aim + shift, rtol=0, atol=1e-9)
    for name in ("arrival_s", "lateral_m", "depth_m", "turn_rad", "turned_axis"):
        np.testing.assert_allclose(getattr(there, name), getattr(here, name), rtol=0, atol=1e-6, err_msg=name)
    assert there.turned_probability == pytest.approx(here.turned_probability, abs=1e-6)


def test_the_turn_is_to_where_the_target_will_be_once_turned():
    """Aside by 20 mm/s: met at (45, -60) mm from the entry by the turned needle after 0.75 s, not after 0.6 s."""
    found = advise(path_of(lambda t: np.c_[0.045 + 0.02 * (t - 0.75), 0.04 + 0 * t]), DOWN, DISC, needle=TIP)
    assert found.arrival_s == pytest.approx(NOW_S + 0.6, abs=1e-6)
    assert found.aim[0] == pytest.approx(0.042, abs=1e-8)
    np.testing.assert_allclose(found.turned_axis, [0.6, -0.8], rtol=0, atol=1e-6)
    assert found.turn_rad == pytest.approx(np.arctan(0.75), abs=1e-6)


def test_a_turned_needle_that_never_arrives_is_turned_to_where_the_straight_one_would():
    """Aside at 200 mm/s from 45 mm: beside the straight needle after 0.6 s, at 165 mm; the turned one is outrun."""
    found = advise(path_of(lambda t: np.c_[0.045 + 0.2 * t, 0.04 + 0 * t]), DOWN, DISC, needle=TIP)
    assert found.lateral_m == pytest.approx(0.165, abs=1e-6)
    np.testing.assert_allclose(found.turned_axis, np.array([0.165, -0.06]) / np.hypot(0.165, 0.06), rtol=0, atol=1e-6)
    assert found.turned_probability == 0.0
    assert found.advice is Advice.WAIT


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: replace(DOWN, speed_m_s=0.0), "insertion speed_m_s: expected more than 0"),
        (lambda: replace(DOWN, depth_m=-0.1), "insertion depth_m: expected 0 or more"),
        (lambda: replace(DOWN, axis=np.zeros(2)), "expected a finite entry and direction"),
        (lambda: replace(DOWN, axis=np.ones(3)), "expected entry and axis of length 2 or 3"),
        (lambda: Needle(hit="POINT"), "needle hit: expected TIP, NOTCH, CORE, found POINT"),
        (
            lambda: guide(Filter(NOW_S), HEALTHY, Insertion(np.zeros(3), np.eye(3)[0], speed_m_s=0.1), DISC),
            "dimensions: expected the same for estimate and insertion, found 2 and 3",
        ),
        (
            lambda: advise(path_of(at(0.0, 0.0)), DOWN, Lesion.ball(1.0, 3)),
            r"dimensions: expected the same for path, insertion and lesion, found \(2, 2, 3\)",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
