"""Constants of elastic bodies by what marks tell of those withheld. Truth: finite elements by MuJoCo, chain rule."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from dynamics import MassSpringNetwork, independent_uncertainty
from estimators import FilterSettings, IdentificationSettings, MarkMeasurement, identify_constants
from estimators.identification.budget import Budget
from estimators.identification.constants import PRIOR_SD
from estimators.identification.filter_pass import Pass
from estimators.identification.linear_filter import LinearFilter, first_shape
from estimators.identification.residuals import residual_covariance, times_counted
from estimators.identification.search import gauss_newton
from estimators.identification.withheld import against_hands, is_elastic, withheld_pass
from experiments.simulation.bodies.zoo import make_body
from experiments.studies.zoo.constants import measured

SD = 1e-3


def row():
    """Two masses in a row between two anchors along x, no gravity."""
    return MassSpringNetwork(
        names=("A", "near", "far", "B"),
        positions=np.array([[0.0, 0.0], [0.1, 0.0], [0.2, 0.0], [0.3, 0.0]]),
        masses=np.full(4, 0.2),
        fixed=np.array([True, False, False, True]),
        drag=np.full(4, 0.3),
        friction=np.zeros(4),
        springs=np.array([[0, 1], [1, 2], [2, 3]]),
        stiffness=np.full(3, 40.0),
        rest_lengths=np.full(3, 0.08),
        damping=np.full(3, 0.2),
        gravity=np.zeros(2),
    )


def marks(k, names=("near", "far")):
    places = {"near": [0.1 + 2e-3 * np.sin(0.4 * k), 0.0], "far": [0.2 + 1e-3 * np.sin(0.4 * k), 1e-4]}
    return [MarkMeasurement(name, places[name], SD**2 * np.eye(2)) for name in names]


def test_what_is_told_of_a_withheld_mark_is_its_conditional_probability():
    """Chain rule: log p(far | near, before) is log p(near, far | before) less log p(near | before)."""
    network, none = row(), independent_uncertainty((), 1.0)
    linear = LinearFilter(network, ("near",), FilterSettings(), none, 0.0)
    linear.start(first_shape(network, marks(0, ("near",))), marks(0, ("near",)))
    told = 0.0
    for k in range(1, 9):
        together, alone = deepcopy(linear).advance(0.05, marks(k)), linear.advance(0.05, marks(k, ("near",)))
        assert not together.poked
        told += together.log_likelihood - alone.log_likelihood
    frames = [(0.05 * k, marks(k)) for k in range(9)]
    found = withheld_pass(network, none, frames, (("near",), "far"), FilterSettings(), Budget())
    assert found.composite
    assert found.log_likelihood == pytest.approx(told, rel=1e-9)
    assert found.dof.sum() == 16


def test_frames_before_the_first_that_the_filter_may_start_from_are_left_out():
    """As those without any mark are of other bodies."""
    none = independent_uncertainty((), 1.0)
    frames = [(0.05 * k, marks(k)) for k in range(9)]
    late = [(-0.05, marks(0, ("far",))), *frames]
    one, other = (
        withheld_pass(row(), none, each, (("near",), "far"), FilterSettings(), Budget()) for each in (frames, late)
    )
    assert np.isfinite(one.log_likelihood)
    assert other.log_likelihood == one.log_likelihood


def repeated(theta, *, times, composite):
    """200 numbers z = T theta + noise of variance 1, each in so many frames one after the other."""
    rng = np.random.default_rng(5)
    T = 0.1 * np.ones((200, 1))
    y = np.repeat(0.1 * 2.0 + rng.normal(size=200) - T @ theta, times)
    told = Pass(0.1 * y[:, None], 0.01 * len(y) * np.eye(1), -0.5 * float(y @ y), y**2, np.ones(len(y)))
    return replace(told, composite=composite)


def test_what_frames_repeat_is_counted_about_once():
    """Five frames that say the same: the posterior is that of one each, and not five times as sure.

    The lags, 31 of 1,000 frames, hold four fifths to all of a repetition; the variance of 31 lags scatters by a fifth.
    """
    once = gauss_newton(lambda theta: repeated(theta, times=1, composite=False), np.zeros(1), np.ones(1))
    each = gauss_newton(lambda theta: repeated(theta, times=5, composite=True), np.zeros(1), np.ones(1))
    assert each.times == pytest.approx(5.0, rel=0.4)
    assert each.theta[0] == pytest.approx(once.theta[0], rel=0.1)
    cov, test = residual_covariance(each.found, np.eye(1))
    plain, _ = residual_covariance(once.found, np.eye(1))
    assert cov[0, 0] == pytest.approx(plain[0, 0], rel=0.4)
    assert test.n == 1000
    assert test.n_effective == pytest.approx(200.0, rel=0.4)
    assert times_counted(replace(each.found, composite=False)) == 1.0


@pytest.mark.parametrize(
    ("name", "elastic"), [("floating", True), ("block27", True), ("sheet", False), ("cable-slow", False)]
)
def test_a_block_is_elastic_and_what_its_weight_keeps_in_shape_is_not(name, elastic):
    """A block of Young's modulus E, density d and length L returns with E / (d L), about 17 to 51 g; others with g."""
    body = make_body(name, 0, seconds=0.1)
    assert is_elastic(body.network, len(body.marked)) == elastic


def test_a_hand_is_as_strong_as_bending_the_body_takes():
    """E / (d L) of the gel block is 510 m/s²; a tenth of that, and the usual 50 m/s² at least."""
    block = make_body("block27", 0, seconds=0.1).network
    hand = against_hands(FilterSettings(), replace(block, stiffness=10.0 * block.stiffness))
    assert hand.poked.poke == pytest.approx(510.0, rel=0.5)
    assert against_hands(FilterSettings(), block).poked.poke == pytest.approx(50.0, rel=0.2)


def test_a_block_that_hands_lead_is_found_about_as_stiff_as_it_is():
    """Each stiffness within a factor of two of that by Young's modulus; by all marks 50 times too limp and more."""
    body = make_body("floating", 100_024, seconds=1.3)
    names = body.marked + body.hidden
    frames = list(zip(body.times_s.tolist(), measured(body, names, 100_024), strict=True))
    prior = {kind: sd for kind, sd in PRIOR_SD.items() if kind != "rest_length"}
    softer = replace(body.network, stiffness=0.8 * body.network.stiffness, damping=0.8 * body.network.damping)
    found = identify_constants(
        softer,
        frames,
        body.marked,
        body.hidden[0],
        prior_sd=prior,
        spring_groups=body.kinds,
        search=IdentificationSettings(n_starts=1),
    )
    factors = found.network.stiffness / body.network.stiffness
    assert factors.min() > 0.5
    assert factors.max() < 2.0
    # springs that hands stretch slowly are no rigid links, whatever oscillations the frames miss
    np.testing.assert_allclose(found.prior_sd[:2], PRIOR_SD["stiffness"])
    assert found.target_error_m < 1.1 * found.target_error_before_m  # such a scene is written
    assert not found.residuals.explained
