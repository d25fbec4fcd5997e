"""A filter that believes one marked node at a time to be poked."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import FilterSettings, TissueFilter
from estimators.tissue.settings import stationary

FRAME_S = 4 / 120.0
USUAL = FilterSettings()
ONE = replace(USUAL, poked=replace(USUAL.poked, poke=3.4), one_of=len(OUTER))


@pytest.fixture(scope="module")
def poked_on(phantom, rest_state, driven, marks_of):
    """Frames of 1 s of a phantom at rest, one outer mass of which is pushed with 8 m/s² from 0.7 s on; noise 1 mm."""

    def frames(node):
        rng = np.random.default_rng(3)
        forces = np.zeros((120, len(phantom.free), 2))
        at = phantom.free.tolist().index(phantom.index(node))
        forces[84:, at] = 0.2 * np.array([4.8, -6.4])
        states = driven(phantom, rest_state, forces)
        return [(k * FRAME_S, marks_of(phantom, state, 1e-3, rng)) for k, state in enumerate(states[::4])]

    return frames


@pytest.mark.parametrize("k", range(3))
def test_it_tells_which_node_is_poked(phantom, poked_on, k):
    """0.3 s of 8 m/s² on one of them: its mode has four fifths of the odds; before, all poked ones 5 % at most."""
    tissue, before = TissueFilter(phantom, HIDDEN, OUTER, ONE), []
    for time_s, marks in poked_on(OUTER[k]):
        tissue.predict(time_s)
        estimate = tissue.update(marks)
        if 0.3 < time_s < 0.7:
            before.append(estimate.poked)
    assert tissue.mixture.mu[2 + k] > 0.8
    assert estimate.poked == pytest.approx(tissue.mixture.mu[2:].sum(), rel=1e-12)
    assert max(before) < 0.05


def test_pokes_come_as_often_as_with_one_poked_mode():
    """Long-run odds: calm and between as with one poked mode and no blows, the poked share theirs evenly. Rounding."""
    odds, usual = stationary(ONE.rates), stationary(replace(USUAL, unstruck_s=np.inf).rates)
    np.testing.assert_allclose(odds, [usual[0], usual[1], *[usual[2] / 3] * 3], rtol=1e-9)
    np.testing.assert_allclose(ONE.rates.sum(axis=1), 0.0, atol=1e-12)
    assert ONE.poked_share(odds) == pytest.approx(usual[2], rel=1e-9)


def test_marks_are_looked_for_as_if_poked(phantom, rest_state, marks_of):
    """Rest, marks of 1 mm, then 0.1 s without: 3.4 mm tell a node that may be poked meanwhile from one that is not."""
    tissue = TissueFilter(phantom, HIDDEN, OUTER, ONE)
    for k in range(30):
        tissue.predict(k * FRAME_S)
        tissue.update(marks_of(phantom, rest_state, 1e-3, np.random.default_rng(k)))
    tissue.predict(29 * FRAME_S + 0.1)
    for node in OUTER:
        rows = phantom.coordinates(node)
        sigma = np.sqrt(np.trace(tissue.expected(node)[1]))
        between = np.sqrt(np.trace(tissue.mixture.filters[1].P[rows, rows]))
        assert between < 3.4e-3 < sigma


def test_pokes_are_followed_and_never_refused(phantom, rest_state, driven, poke_forces, marks_of):
    """Half-sine pokes of up to 10 m/s², every frame of 6 s, marks of 1 mm: no mark is refused, the health stands."""
    rng = np.random.default_rng(9)
    states = driven(phantom, rest_state, poke_forces(phantom, 6.0, rng))
    tissue = TissueFilter(phantom, HIDDEN, OUTER, ONE)
    for k, state in enumerate(states[::4]):
        tissue.predict(k * FRAME_S)
        tissue.update(marks_of(phantom, state, 1e-3, rng))
    assert sum(tissue.rejected.values()) == 0
    assert not tissue.repairs["inflated"]


def test_as_many_modes_as_marked_nodes(phantom):
    with pytest.raises(ValueError, match="one_of: expected 0 or 2 marked nodes, found 3"):
        TissueFilter(phantom, HIDDEN, OUTER[:2], ONE)
