"""Long gaps between frames: bounded in time, and what is left of the state after them."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import FilterSettings, FixBias, Status, UnifiedFilter

EXACT = FilterSettings(forget_s=np.inf, fix_bias=FixBias(2e-3))
"""Every second of a gap is integrated."""


def swinging(phantom, rest_state, marks_of, settings):
    """A filter that has seen M3 30 mm aside and back: the tissue swings, a fix has shown a bias."""
    tissue = UnifiedFilter(phantom, HIDDEN, OUTER, settings)
    for k in range(20):
        state = rest_state.copy()
        state[4] += 0.03 * np.sin(0.3 * k)
        tissue.predict(k / 30.0)
        tissue.update(marks_of(phantom, state))
    tissue.fix(rest_state[phantom.coordinates(HIDDEN)] + 1e-3, 1e-8 * np.eye(2))
    return tissue


@pytest.mark.parametrize("gap_s", [6.0, 12.0])
def test_a_gap_that_is_skipped_leaves_what_an_integrated_one_does(phantom, rest_state, marks_of, gap_s):
    """Mean of the target to 0.05 mm, its sigmas to 1 %, the odds of the modes to 1e-9, the bias to a tenth of its sd.

    Not to rounding: 5 s are integrated from a start at rest, of which the tissue keeps less than 1 % so long.
    """
    whole, skipped = (
        swinging(phantom, rest_state, marks_of, settings) for settings in (EXACT, replace(EXACT, forget_s=5.0))
    )
    for tissue in (whole, skipped):
        tissue.predict(tissue.time_s + gap_s)
    assert skipped.repairs["forgotten"] == 1
    assert whole.repairs["forgotten"] == 0
    a, b = (tissue.target.position(tissue.mixture.x) for tissue in (whole, skipped))
    np.testing.assert_allclose(b, a, rtol=0, atol=5e-5)
    A, B = (np.sqrt(np.diag(tissue.target.cov(tissue.mixture.P))) for tissue in (whole, skipped))
    np.testing.assert_allclose(B, A, rtol=0.01)
    np.testing.assert_allclose(skipped.mixture.mu, whole.mixture.mu, rtol=0, atol=1e-9)
    own = whole.model.bias_rows
    np.testing.assert_allclose(skipped.mixture.x[own], whole.mixture.x[own], rtol=0, atol=2e-4)
    np.testing.assert_allclose(
        np.sqrt(np.diag(skipped.mixture.P)[own]), np.sqrt(np.diag(whole.mixture.P)[own]), rtol=0.02
    )


def test_the_target_after_long_gaps_is_predicted_without_moving_the_state(phantom, rest_state, marks_of):
    """`predict_at` a day and a year ahead: the target of the long run, and LOST is not what the filter is now."""
    tissue = swinging(phantom, rest_state, marks_of, FilterSettings(fix_bias=FixBias(2e-3)))
    x, now = tissue.mixture.x, tissue.time_s
    now_m2, day_m2, year_m2 = (np.trace(tissue.predict_at(now + gap_s).cov) for gap_s in (0.0, 86_400.0, 3e7))
    assert day_m2 > 10.0 * now_m2
    assert year_m2 == pytest.approx(day_m2, rel=1e-6)
    np.testing.assert_array_equal(tissue.mixture.x, x)
    assert tissue.health.status is Status.TRACKING
    assert tissue.repairs["forgotten"] == 0


def test_a_known_force_acts_to_the_end_of_a_long_gap(phantom, rest_state, marks_of):
    """1 N on M2 to the right in the last 4 s of an hour: the target ends up where it does after 4 s of it."""
    tissue = UnifiedFilter(phantom, HIDDEN, OUTER)
    for k in range(10):
        tissue.predict(k / 30.0)
        tissue.update(marks_of(phantom, rest_state))
    end_s = tissue.time_s + 3600.0

    def push(time_s, _states):
        force = np.zeros((4, 2))
        force[1, 0] = 1.0 if time_s > end_s - 4.0 else 0.0
        return force

    pushed = tissue.predict_at(end_s, push).mean - tissue.predict_at(end_s).mean
    soon = (
        tissue.predict_at(tissue.time_s + 4.0, push=push(end_s, None)).mean
        - tissue.predict_at(tissue.time_s + 4.0).mean
    )
    assert pushed[0] > 5e-3
    np.testing.assert_allclose(pushed, soon, rtol=0, atol=2e-4)
