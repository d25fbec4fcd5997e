"""Long gaps between frames: bounded in time, and what is left of the state after them."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import FilterSettings, Status, TissueFilter
from tests.estimators.conftest import followed, marks_of


def swinging(phantom, rest_state, settings):
    """A filter that has seen M3 30 mm aside and back: the tissue swings, a fix has shown a bias."""
    tissue, aside = TissueFilter(phantom, HIDDEN, OUTER, settings), np.eye(len(rest_state))[4]
    states = [rest_state + 0.03 * np.sin(0.3 * k) * aside for k in range(20)]
    followed(tissue, [(k / 30.0, marks_of(phantom, state)) for k, state in enumerate(states)])
    tissue.fix(rest_state[phantom.coordinates(HIDDEN)] + 1e-3, 1e-8 * np.eye(2))
    return tissue


@pytest.mark.parametrize("gap_s", [5.5, 1e300])
def test_after_a_gap_beyond_forget_s_the_filter_begins_again(phantom, rest_state, gap_s):
    """LOST, where nothing but the prior is known; the next marks are all taken in."""
    tissue = swinging(phantom, rest_state, FilterSettings())
    tissue.predict(tissue.time_s + gap_s)
    assert tissue.health.status is Status.LOST
    new = TissueFilter(phantom, HIDDEN, OUTER)
    for found, expected in zip(tissue.place_of(tissue.target), new.place_of(new.target), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    estimate = tissue.update(marks_of(phantom, rest_state))
    assert (estimate.status, estimate.marks_used) == (Status.INITIALISING, 3)
    assert tissue.repairs["restarted"] == 1
