"""Forces of a recording, found without truth, and scores that vanish on average where the constants are right."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from dynamics import MassSpringNetwork, Parameter, independent_uncertainty, pack, scale_parameters
from estimators import Budget, FilterSettings, ForceMode, MarkMeasurement, TissueFilter
from estimators.filters.unscented import CovarianceError
from estimators.identification.budget import OutOfTimeError
from estimators.identification.filter_pass import failed_pass, pass_through
from estimators.identification.forced.centring import score_moments, simulated
from estimators.identification.forced.forced_filter import Forces, Poke, forces_between
from estimators.identification.forced.forces import (
    Recorded,
    find_forces,
    forced_pass,
    intervals,
    poked_frames,
    smoothed,
)
from estimators.identification.forced.refined import Scaled, under_forces
from tests.estimators.identification.test_constants import chain

SD = 5e-4
WHITE = 0.1
SETTINGS = FilterSettings(quiet=ForceMode(WHITE, WHITE, 0.05), poked=ForceMode(WHITE, 2.0, 0.2))
MASS, STIFFNESS, DRAG = 0.2, 40.0, 0.8


@pytest.fixture(scope="module")
def poked(driven):
    """4 s at 30 frames/s: `near` is pushed along x at 1 s, `far` along y at 2.5 s, each for 0.3 s at up to 5 m/s²."""
    network, rng = chain(), np.random.default_rng(5)
    forces = MASS * WHITE * np.sqrt(120.0) * rng.normal(size=(4 * 120, 2, 2))
    forces[120:156, 0, 0] += 5.0 * MASS * np.sin(np.linspace(0.0, np.pi, 36))
    forces[300:336, 1, 1] += 5.0 * MASS * np.sin(np.linspace(0.0, np.pi, 36))
    states = driven(network, pack(network.positions[1:3], np.zeros((2, 2))), forces)[::4]
    cov = SD**2 * np.eye(2)
    frames = []
    for k, state in enumerate(states):
        places = state[:4].reshape(2, 2) + rng.normal(0.0, SD, (2, 2))
        frames.append((k / 30.0, [MarkMeasurement(n, p, cov) for n, p in zip(("near", "far"), places, strict=True)]))
    return Recorded(frames, (("near", "far"), "far"), SETTINGS, Budget())


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


def test_who_was_poked_when_and_how_strongly(poked):
    """Levels: of a half sine of 5 m/s² along one axis of two over its time, 5 / 2 = 2.5 m/s² an axis.

    Intervals have margins in which nothing acts, so that the level is lower; the other node's is a fifth at most.
    """
    forces = find_forces(chain(), poked, None)
    level = {(poke.place, poke.first): poke.level for poke in forces.pokes}
    runs = sorted({(poke.first, poke.last) for poke in forces.pokes})
    assert len(runs) == 2
    for (first, last), node, start in zip(runs, (0, 1), (30, 75), strict=True):
        assert start - 3 <= first <= start + 2
        assert start + 7 <= last <= start + 13
        assert 1.2 < level[node, first] < 3.0
        assert level[1 - node, first] < 0.25 * level[node, first]
    assert forces.white == pytest.approx(WHITE, rel=0.3)
    assert forces.marks == pytest.approx(1.0, rel=0.1)


def test_smoothed_forces_are_those_that_acted(poked):
    """In the middle of each poke, 5 m/s² by the mass: to 1.5 N per kg."""
    network = chain()
    means, variances = smoothed(network, poked, find_forces(network, poked, None))
    pokes = means[:, network.n_state :] / MASS
    np.testing.assert_allclose(pokes[34], [5.0, 0.0, 0.0, 0.0], atol=1.5)
    np.testing.assert_allclose(pokes[79], [0.0, 0.0, 0.0, 5.0], atol=1.5)
    assert np.abs(pokes[60]).max() < 0.2
    assert (variances > 0.0).all()


def test_without_pokes_it_is_the_filter_of_the_bank(poked):
    """In frames without a poke both filters have the same information on constants, but for the bank's odds: 20 %."""
    network = chain()
    calm = replace(poked, frames=poked.frames[:28])
    uncertainty = independent_uncertainty((Parameter("stiffness", 1), Parameter("rest_length", 1)), [0.3, 0.05])
    ours = forced_pass(network, uncertainty, calm, Forces(WHITE))
    bank = pass_through(network, uncertainty, calm.frames, calm.nodes, replace(SETTINGS, test_sigmas=np.inf), Budget())
    np.testing.assert_allclose(np.diag(ours.information), np.diag(bank.information), rtol=0.2)
    assert ours.log_likelihood == pytest.approx(bank.log_likelihood, abs=5.0)


def pendant():
    """One mass on four equal springs at right angles: near its rest each axis is one linear oscillator with drag."""
    return MassSpringNetwork(
        names=("m", "L", "R", "D", "U"),
        positions=np.array([[0.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]]),
        masses=np.array([MASS, 1.0, 1.0, 1.0, 1.0]),
        fixed=np.array([False, True, True, True, True]),
        drag=np.array([DRAG, 0.0, 0.0, 0.0, 0.0]),
        friction=np.zeros(5),
        springs=np.array([[0, 1], [0, 2], [0, 3], [0, 4]]),
        stiffness=np.full(4, 0.5 * STIFFNESS),
        rest_lengths=np.full(4, 1.0),
        damping=np.zeros(4),
        gravity=np.zeros(2),
    )


def pendant_frames(rng, n_frames=61, dt=1.0 / 30.0):
    """Marks of the mass under white noise alone, by the exact transition of its equations; no code of ours."""
    A = np.array([[0.0, 1.0], [-STIFFNESS / MASS, -DRAG / MASS]])
    h = dt / 20.0
    F = expm(A * h)
    state, frames, cov = np.zeros((2, 2)), [], SD**2 * np.eye(2)
    for k in range(n_frames):
        frames.append((k * dt, [MarkMeasurement("m", state[0] + rng.normal(0.0, SD, 2), cov)]))
        for _ in range(20):
            state = F @ state
            state[1] += WHITE * np.sqrt(h) * rng.normal(size=2)
    return frames


@pytest.mark.slow
def test_a_score_is_centred_where_forces_are_supposed_that_do_not_act(monkeypatch):
    """Drag at its true value, pokes supposed in a third of the frames, none acting: the score of drag has a mean.

    Over 100 recordings that mean is above nought by more than 3 of its standard errors. What 100 simulated recordings
    of the first of them have for a mean is within 3 of the two means' standard errors of it, and farther from nought.
    """
    monkeypatch.setattr("estimators.identification.forced.centring.SIMULATED", 100)
    network, rng = pendant(), np.random.default_rng(2)
    uncertainty = independent_uncertainty((Parameter("drag", 0),), [0.5])
    forces = Forces(WHITE, pokes=tuple(Poke(0, k, k + 4, 4.0) for k in range(5, 60, 14)))
    scores, first = [], None
    for _ in range(100):
        seen = Recorded(pendant_frames(rng), (("m",), "m"), SETTINGS, Budget())
        first = seen if first is None else first
        scores.append(forced_pass(network, uncertainty, seen, forces).gradient[0])
    mean, error = np.mean(scores), np.std(scores, ddof=1) / np.sqrt(len(scores))
    moments = score_moments(network, uncertainty, first, forces)
    assert mean > 3.0 * error
    simulated_error = np.sqrt(moments.mean_cov[0, 0])
    assert abs(mean - moments.mean[0]) < 3.0 * np.hypot(error, simulated_error)
    assert moments.mean[0] > 3.0 * simulated_error
    assert simulated_error == pytest.approx(error, rel=0.3)


def test_recordings_that_leave_no_finite_filter_have_no_moments(poked, monkeypatch):
    monkeypatch.setattr("estimators.identification.forced.centring.forced_pass", lambda *_: failed_pass(1))
    uncertainty = independent_uncertainty((Parameter("drag", 1),), [0.5])
    with pytest.raises(CovarianceError, match=r"expected two or more of finite likelihood, found 0"):
        score_moments(chain(), uncertainty, poked, Forces(WHITE))


def test_simulated_recordings_have_the_marks_of_the_true_one(poked):
    """Times and nodes are the same; places differ by the noises: by 0.1 to 10 of the marks' standard deviations."""
    network = chain()
    lost = [(t, marks[:1] if k % 7 == 3 else marks) for k, (t, marks) in enumerate(poked.frames)]
    seen = replace(poked, frames=lost)
    first, second = simulated(network, seen, find_forces(network, seen, None), 2)
    assert [(t, [m.node for m in marks]) for t, marks in first] == [(t, [m.node for m in marks]) for t, marks in lost]
    for a, b in ((first, second), (first, lost)):
        apart = [
            m.position - n.position
            for (_, one), (_, two) in zip(a, b, strict=True)
            for m, n in zip(one, two, strict=True)
        ]
        assert 0.1 * SD < np.sqrt(np.mean(np.square(apart))) < 10.0 * SD


def of_one_stiffness():
    """The middle spring's stiffness by its prior deviation of 30 %."""
    constants = (Parameter("stiffness", 1),)
    return Scaled(
        lambda theta: scale_parameters(chain(), constants, 0.3 * theta),
        lambda _network: independent_uncertainty(constants, [0.3]),
        np.array([0.3]),
        lambda: None,
    )


@pytest.mark.parametrize(("error", "in_time"), [(OutOfTimeError(), False), (CovarianceError("none"), True)])
def test_what_cannot_be_centred_is_kept_beside_the_constants_given(poked, monkeypatch, error, in_time):
    """The pass of the constants given is at 0, wherever the search began: the same pass made anew, bit for bit."""

    def fails(*_):
        raise error

    monkeypatch.setattr("estimators.identification.forced.refined.score_moments", fails)
    scaled = of_one_stiffness()
    found = under_forces(scaled, poked, np.array([0.8]))
    assert found is not None
    assert abs(found.optimum.theta[0]) < 0.5
    assert found.optimum.in_time is in_time
    given = forced_pass(chain(), scaled.prior(chain()), poked, found.forces)
    assert found.given.log_likelihood == given.log_likelihood
    assert found.given.log_likelihood != found.optimum.at_start.log_likelihood


def test_forces_that_are_not_found_again_leave_the_first_result(poked, monkeypatch):
    forces = find_forces(chain(), poked, None)

    def at_first(_network, _seen, before):
        if before is None:
            return forces
        raise CovarianceError("none")

    monkeypatch.setattr("estimators.identification.forced.refined.find_forces", at_first)
    found = under_forces(of_one_stiffness(), poked, np.zeros(1))
    assert found is not None
    assert found.forces is forces


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
    network, rng = replace(chain(), damping=np.full(3, 14.0)), np.random.default_rng(6)
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
