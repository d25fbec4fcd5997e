"""A pass of the filter: how probable hidden marks are, and the derivative of that. Truth: chain rule, differences."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import Parameter, independent_uncertainty, scale_parameters
from estimators import Budget, FilterSettings, MarkMeasurement, TissueFilter
from estimators.core.discrepancy import Discrepancy
from estimators.core.disturbances import Disturbances
from estimators.identification.filter_pass import pass_through
from tests.estimators.conftest import followed
from tests.networks import build_network

SD = 1e-3
NODES = ("near",), "far"
SETTINGS = FilterSettings(discrepancy=0.003)


def row():
    """Two masses in a row between two anchors along x, no gravity."""
    constants = {"drag": 0.3, "stiffness": 40.0, "rest_lengths": 0.08, "damping": 0.2}
    positions, springs = [[0.1 * k, 0.0] for k in range(4)], [(0, 1), (1, 2), (2, 3)]
    return build_network(positions, springs, (0, 3), ("A", "near", "far", "B"), **constants)


def marks(k, names=("near", "far")):
    """Along the row; what lies across is not seen, for how stiff the row is across depends on its rest lengths."""
    places = {"near": [0.1 + 2e-4 * np.sin(0.4 * k), 0.0], "far": [0.201 + 1e-4 * np.sin(0.4 * k), 0.0]}
    return [MarkMeasurement(name, places[name], np.diag([SD**2, 1.0])) for name in names]


KNOWN = replace(Discrepancy.of(SETTINGS), noises=((1.0, 1.0),))
"""The noise of marks is as stated, as in a pass."""

FRAMES = [(0.05 * k, marks(k)) for k in range(20)]


def passed(network, which=(), frames=FRAMES):
    return pass_through(network, independent_uncertainty(which, 1.0), frames, NODES, SETTINGS, Budget())


@pytest.fixture
def one_mode(monkeypatch):
    """All modes have the same forces: their weights do not depend on constants."""
    same = Disturbances(poke_m_s2=0.01, led_m_s2=0.01, slow_m_s2=(0.0,), bent=0.0)
    monkeypatch.setattr(Disturbances, "of", lambda _settings, **_options: same)


def test_how_probable_a_hidden_mark_is_follows_from_the_chain_rule():
    """Log p(far | near, before) is log p(near, far | before) less log p(near | before)."""
    tissue, expected = TissueFilter(row(), "far", ("near",), SETTINGS, discrepancy=KNOWN), 0.0
    for k, (time_s, both) in enumerate(FRAMES):
        tissue.predict(time_s)
        if k:
            before = tissue.snapshot()
            tissue.filter.update([tissue.places(both)])
            expected += tissue.filter.log_likelihood
            tissue.restore(before)
            tissue.update(both[:1])
            expected -= tissue.log_likelihood
        else:
            tissue.update(both[:1])
            first = tissue.filter.innovations([tissue.places(both[1:])])
            expected += float(np.logaddexp.reduce(first.logs)) - np.log(2.0 * np.pi)
    found = passed(row())
    assert found.log_likelihood == pytest.approx(expected, rel=1e-6)
    assert found.dof.sum() == 2 * len(FRAMES)


@pytest.mark.usefixtures("one_mode")
def test_the_gradient_is_the_slope_of_the_log_likelihood():
    """Against central differences, of constants on which gains do not depend: rest lengths, motion along the row."""
    which = tuple(Parameter("rest_length", s) for s in range(3))
    gradient = passed(row(), which).gradient
    slopes = []
    for one in which:
        ends = [passed(scale_parameters(row(), (one,), [step])).log_likelihood for step in (0.01, -0.01)]
        slopes.append((ends[0] - ends[1]) / 0.02)
    np.testing.assert_allclose(gradient, slopes, rtol=0.05)


@pytest.mark.usefixtures("one_mode")
def test_the_information_is_the_curvature_of_the_log_likelihood():
    which = (Parameter("rest_length", 0),)
    information = passed(row(), which).information[0, 0]
    low, at, high = (passed(scale_parameters(row(), which, [step])).log_likelihood for step in (-0.02, 0.0, 0.02))
    assert information == pytest.approx(-(high + low - 2.0 * at) / 4e-4, rel=0.1)


def test_frames_before_the_first_mark_of_a_marked_node_are_left_out():
    late = [(-0.05, marks(0, ("far",))), *FRAMES]
    assert passed(row(), frames=late).log_likelihood == passed(row()).log_likelihood


def test_a_hidden_mark_that_is_something_else_hardly_matters():
    """80 mm off in one frame: that frame has no gradient, the others have theirs, and it counts as an outlier."""
    which = (Parameter("rest_length", 0),)
    wrong = [
        replace(mark, position=mark.position + np.array([0.08, 0.0])) if mark.node == "far" else mark
        for mark in marks(7)
    ]
    there, usual = passed(row(), which, [*FRAMES[:7], (0.35, wrong), *FRAMES[8:]]), passed(row(), which)
    np.testing.assert_allclose(there.scores[8:], usual.scores[8:], rtol=1e-9)
    assert abs(there.scores[7]) < 0.01 * abs(usual.scores[7])
    assert there.n_outliers == pytest.approx(1.0, abs=1e-3)
    assert usual.n_outliers == 0.0
    assert usual.n_hidden == there.n_hidden == len(FRAMES)
    assert there.dof.sum() == pytest.approx(2 * len(FRAMES) - 2, abs=1e-3)


def test_the_targets_error_is_that_of_a_filter_without_its_mark():
    tissue = TissueFilter(row(), "far", ("near",), SETTINGS, discrepancy=KNOWN)
    found = followed(tissue, [(time_s, both[:1]) for time_s, both in FRAMES])
    errors = [np.linalg.norm(one.mean - far.position) for one, (_, (_, far)) in zip(found, FRAMES, strict=True)]
    assert passed(row()).target_error_m == pytest.approx(np.median(errors), rel=1e-6)
