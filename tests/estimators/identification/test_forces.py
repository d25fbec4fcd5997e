"""Forces of a recording, found without truth, and constants under them."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import Parameter, independent_uncertainty, pack, scale_parameters
from estimators import Budget, FilterSettings, ForceMode, MarkMeasurement, TissueFilter
from estimators.filters.unscented import CovarianceError
from estimators.identification.budget import OutOfTimeError
from estimators.identification.filter_pass import pass_through
from estimators.identification.forced.forced_filter import Forces, Poke, forces_between
from estimators.identification.forced.forces import find_forces, forced_pass, intervals, poked_frames, smoothed
from estimators.identification.forced.recorded import Recorded
from estimators.identification.forced.refined import Scaled, under_forces
from tests.estimators.identification.test_constants import chain

SD = 5e-4
WHITE = 0.1
SETTINGS = FilterSettings(quiet=ForceMode(WHITE, WHITE, 0.05), poked=ForceMode(WHITE, 2.0, 0.2))
MASS, STIFFNESS, DRAG = 0.2, 40.0, 0.8


@pytest.fixture(scope="module")
def poked(driven):
    """2.6 s at 30 frames/s: `near` is pushed along x at 0.9 s, `far` along y at 2 s, each for 0.3 s at up to 5 m/s²."""
    network, rng = chain(), np.random.default_rng(5)
    forces = MASS * WHITE * np.sqrt(120.0) * rng.normal(size=(312, 2, 2))
    forces[108:144, 0, 0] += 5.0 * MASS * np.sin(np.linspace(0.0, np.pi, 36))
    forces[240:276, 1, 1] += 5.0 * MASS * np.sin(np.linspace(0.0, np.pi, 36))
    states = driven(network, pack(network.positions[1:3], np.zeros((2, 2))), forces)[::4]
    cov = SD**2 * np.eye(2)
    frames = []
    for k, state in enumerate(states):
        places = state[:4].reshape(2, 2) + rng.normal(0.0, SD, (2, 2))
        frames.append((k / 30.0, [MarkMeasurement(n, p, cov) for n, p in zip(("near", "far"), places, strict=True)]))
    return Recorded(frames, (("near", "far"), "far"), SETTINGS, Budget())


@pytest.fixture(scope="module")
def found_forces(poked):
    return find_forces(chain(), poked, None)


def test_intervals_have_margins_and_are_joined():
    poked = np.zeros(40, dtype=bool)
    poked[[1, 10, 11, 15, 30, 39]] = True
    assert intervals(poked) == [(1, 3), (8, 17), (28, 32), (37, 39)]


def test_pokes_in_a_frame_and_their_mode():
    """Two nodes at once, each at its own level; a third as where nobody pokes."""
    forces = Forces(WHITE, pokes=(Poke(0, 3, 6, 1.0), Poke(2, 5, 9, 4.0), Poke(2, 9, 12, 3.0)))
    assert forces.at(2) == ()
    assert forces.at(5) == ((0, 1.0), (2, 4.0))
    assert forces.at(9) == ((2, 4.0),)
    (mode,) = forces_between(ForceMode(WHITE, 0.1, 0.05), 0.2, forces.at(5))
    sd, lasting = mode.pokes(3, 2)
    np.testing.assert_array_equal(sd, [1.0, 1.0, 0.1, 0.1, 4.0, 4.0])
    np.testing.assert_array_equal(lasting, [0.2, 0.2, 0.05, 0.05, 0.2, 0.2])


def test_who_was_poked_when_and_how_strongly(found_forces):
    """Levels: of a half sine of 5 m/s² along one axis of two over its time, 5 / 2 = 2.5 m/s² an axis.

    Intervals have margins in which nothing acts, so that the level is lower; the other node's is a fifth at most.
    """
    forces = found_forces
    level = {(poke.place, poke.first): poke.level for poke in forces.pokes}
    runs = sorted({(poke.first, poke.last) for poke in forces.pokes})
    assert len(runs) == 2
    for (first, last), node, start in zip(runs, (0, 1), (27, 60), strict=True):
        assert start - 3 <= first <= start + 2
        assert start + 7 <= last <= start + 13
        assert 1.2 < level[node, first] < 3.0
        assert level[1 - node, first] < 0.25 * level[node, first]
    assert forces.white == pytest.approx(WHITE, rel=0.3)
    assert forces.marks == pytest.approx(1.0, rel=0.1)


def test_smoothed_forces_are_those_that_acted(poked, found_forces):
    """In the middle of each poke, 5 m/s² by the mass: to 1.5 N per kg."""
    network = chain()
    means, variances = smoothed(network, poked, found_forces)
    pokes = means[:, network.n_state :] / MASS
    np.testing.assert_allclose(pokes[31], [5.0, 0.0, 0.0, 0.0], atol=1.5)
    np.testing.assert_allclose(pokes[64], [0.0, 0.0, 0.0, 5.0], atol=1.5)
    assert np.abs(pokes[49]).max() < 0.2
    assert (variances > 0.0).all()


def test_without_pokes_it_is_the_filter_of_the_bank(poked):
    """In frames without a poke both filters have the same information on constants, but for the bank's odds: 20 %."""
    network = chain()
    calm = replace(poked, frames=poked.frames[:25])
    uncertainty = independent_uncertainty((Parameter("stiffness", 1), Parameter("rest_length", 1)), [0.3, 0.05])
    ours = forced_pass(network, uncertainty, calm, Forces(WHITE))
    bank = pass_through(network, uncertainty, calm.frames, calm.nodes, replace(SETTINGS, test_sigmas=np.inf), Budget())
    np.testing.assert_allclose(np.diag(ours.information), np.diag(bank.information), rtol=0.2)
    assert ours.log_likelihood == pytest.approx(bank.log_likelihood, abs=5.0)


def of_one_stiffness():
    """The middle spring's stiffness by its prior deviation of 30 %."""
    constants = (Parameter("stiffness", 1),)
    return Scaled(
        lambda theta: scale_parameters(chain(), constants, 0.3 * theta),
        lambda theta, move: theta + move,
        lambda _network: independent_uncertainty(constants, [0.3]),
        np.eye(1),
        np.array([0.3]),
        lambda _passes: None,
    )


@pytest.mark.parametrize("in_time", [False, True])
def test_without_likelihoods_it_is_where_scores_vanish(poked, found_forces, monkeypatch, in_time):
    """The pass of the constants given is at 0, wherever the search began: the same pass made anew, bit for bit."""

    def none(points, _seen):
        if not in_time:
            raise OutOfTimeError
        return np.full(len(points), -np.inf)

    monkeypatch.setattr("estimators.identification.forced.refined.log_likelihoods", none)
    monkeypatch.setattr("estimators.identification.forced.refined.find_forces", lambda *_: found_forces)
    scaled = of_one_stiffness()
    found = under_forces(scaled, poked, np.array([0.8]))
    assert found is not None
    assert found.information is None
    assert abs(found.optimum.theta[0]) < 0.5
    assert found.optimum.in_time is in_time
    given = forced_pass(chain(), scaled.prior(chain()), poked, found.forces)
    assert found.given.log_likelihood == given.log_likelihood
    assert found.given.log_likelihood != found.optimum.at_start.log_likelihood


def test_forces_that_are_not_found_again_leave_the_first_result(poked, found_forces, monkeypatch):

    def at_first(_network, _seen, before):
        if before is None:
            return found_forces
        raise CovarianceError("none")

    monkeypatch.setattr("estimators.identification.forced.refined.find_forces", at_first)
    found = under_forces(of_one_stiffness(), poked, np.zeros(1))
    assert found is not None
    assert found.forces is found_forces


def test_without_time_for_a_first_result_it_is_said(poked, monkeypatch):
    def late(*_):
        raise OutOfTimeError

    monkeypatch.setattr("estimators.identification.forced.refined.find_forces", late)
    with pytest.raises(OutOfTimeError):
        under_forces(of_one_stiffness(), poked, np.zeros(1))


def test_pokes_of_a_stiff_body_are_not_taken_for_noise(driven):
    """Links with dashpots for which the filter takes implicit steps: a push of 5 m/s² of `near` for 0.3 s is seen.

    By the noise that such a body is given where nobody tuned it, three times what acts, it would not be.
    """
    network, rng = replace(chain(), damping=np.full(3, 30.0)), np.random.default_rng(6)
    assert TissueFilter(network, "far", ("near", "far"), SETTINGS).model.stiff
    forces = MASS * WHITE * np.sqrt(120.0) * rng.normal(size=(3 * 120, 2, 2))
    forces[180:216, 0, 0] += 5.0 * MASS * np.sin(np.linspace(0.0, np.pi, 36))
    states = driven(network, pack(network.positions[1:3], np.zeros((2, 2))), forces)[::4]
    marks = [
        [
            MarkMeasurement(n, p + rng.normal(0.0, SD, 2), SD**2 * np.eye(2))
            for n, p in zip(("near", "far"), places, strict=True)
        ]
        for places in states[:, :4].reshape(-1, 2, 2)
    ]
    frames = [(k / 30.0, each) for k, each in enumerate(marks)]
    poked = poked_frames(network, Recorded(frames, (("near", "far"), "far"), SETTINGS, Budget()))
    assert poked[46:54].any()
    assert not poked[:44].any()
