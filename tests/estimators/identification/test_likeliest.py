"""A step to where a likelihood is largest, and likelihoods of many networks at once."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from dynamics import MassSpringNetwork, Parameter, ParameterUncertainty, independent_uncertainty, scale_parameters
from estimators import Budget, FilterSettings, ForceMode, MarkMeasurement
from estimators.filters.unscented import CovarianceError
from estimators.identification.budget import OutOfTimeError
from estimators.identification.forced.centring import simulated, slope_moments
from estimators.identification.forced.forced_filter import Forces, Poke
from estimators.identification.forced.forces import forced_pass
from estimators.identification.forced.likeliest import likeliest
from estimators.identification.forced.likelihoods import log_likelihoods
from estimators.identification.forced.recorded import Recorded

SD = 5e-4
WHITE = 0.1
SETTINGS = FilterSettings(quiet=ForceMode(WHITE, WHITE, 0.05), poked=ForceMode(WHITE, 2.0, 0.2))
MASS, STIFFNESS, DRAG = 0.2, 40.0, 0.8
POKES = tuple(Poke(0, k, k + 4, 4.0) for k in range(5, 60, 14))
NONE = ParameterUncertainty((), np.zeros((0, 0)))


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


def pendant_frames(rng, n_frames, dt=1.0 / 30.0):
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


def recorded(seed, n_frames=61):
    return Recorded(pendant_frames(np.random.default_rng(seed), n_frames), (("m",), "m"), SETTINGS, Budget())


def of_drag(log):
    return scale_parameters(pendant(), (Parameter("drag", 0),), [log])


def test_many_at_once_are_each_by_itself():
    """Networks of other drag, other noise, frames without marks, one beyond the gate: as one pass each, to rounding."""
    seen = recorded(3)
    far = replace(seen.frames[20][1][0], position=seen.frames[20][1][0].position + 0.05)
    frames = [(t, [] if k in (9, 10) else marks) for k, (t, marks) in enumerate(seen.frames)]
    frames[20] = frames[20][0], [far]
    seen = replace(seen, frames=frames)
    cases = [
        (of_drag(log), Forces(white, factor, POKES))
        for log, white, factor in [(-0.5, 0.1, 1.0), (0.0, 0.2, 1.5), (0.8, 0.1, 0.7)]
    ]
    found = log_likelihoods(cases, seen)
    for one, (network, forces) in zip(found, cases, strict=True):
        assert one == pytest.approx(forced_pass(network, NONE, seen, forces).log_likelihood, abs=1e-8)
    assert len(set(found.round(3))) == 3


def test_a_filter_without_a_finite_state_has_no_likelihood():
    """After a mark at 1e200 m; and of frames that do not begin with marks."""
    seen = recorded(3)
    absurd = replace(seen.frames[9][1][0], position=np.full(2, 1e200))
    for k, marks in ((9, [absurd]), (0, [])):
        frames = [*seen.frames[:k], (seen.frames[k][0], marks), *seen.frames[k + 1 :]]
        assert log_likelihoods([(pendant(), Forces(WHITE))], replace(seen, frames=frames)).tolist() == [-np.inf]
    assert np.isfinite(log_likelihoods([(pendant(), Forces(WHITE))], seen)).all()


def test_likelihoods_end_with_the_time():
    times = iter(range(100))
    seen = replace(recorded(3), budget=Budget(30.0, lambda: float(next(times))))
    with pytest.raises(OutOfTimeError):
        log_likelihoods([(pendant(), Forces(WHITE))], seen)


def test_a_parabola_is_left_in_one_step():
    """Correlated, of another scale than the precision given: maximum and curvature are those of the parabola."""
    rng = np.random.default_rng(4)
    A = rng.normal(size=(3, 3))
    bend, top = A @ A.T + np.eye(3), np.array([0.5, -1.0, 0.3])
    found = likeliest(
        lambda points: np.array([-0.5 * (p - top) @ bend @ (p - top) for p in points]),
        lambda move: np.array([0.1, 0.2, 0.3]) + move,
        np.array([0.1, 0.2, 0.3]),
        1.7 * bend + np.eye(3),
    )
    assert found is not None
    np.testing.assert_allclose(found.theta, np.linalg.solve(bend + np.eye(3), bend @ top), atol=1e-9)
    np.testing.assert_allclose(found.information, bend, rtol=1e-9)


def test_the_most_probable_end_is_taken_and_no_worse_one():
    """A likelihood that falls steeply beyond 0.2: no whole step. One that is largest at the start: none at all."""

    def cliff(points):
        return np.array([2.0 * p[0] - 50.0 * max(0.0, p[0] - 0.2) ** 2 for p in points])

    def peak(points):
        return np.array([-20.0 * abs(p[0]) + p[0] for p in points])

    start = np.zeros(1)
    found, stayed = (likeliest(f, lambda move: start + move, start, np.array([[9.0]])) for f in (cliff, peak))
    assert found is not None
    assert stayed is not None
    assert cliff([found.theta])[0] > 0.5 * float(found.theta @ found.theta)
    assert found.theta[0] > 0.0
    assert stayed.theta[0] == 0.0


def test_without_finite_likelihoods_there_is_no_step():
    start = np.zeros(1)
    assert likeliest(lambda points: np.full(len(points), -np.inf), lambda m: start + m, start, 4.0 * np.eye(1)) is None


def test_simulated_recordings_have_the_marks_of_the_true_one():
    """Times and nodes are the same; places differ by the noises: by 0.1 to 10 of the marks' standard deviations."""
    seen = recorded(5)
    lost = replace(seen, frames=[(t, [] if k % 7 == 3 else marks) for k, (t, marks) in enumerate(seen.frames)])
    first, second = simulated(pendant(), lost, Forces(WHITE, pokes=POKES), 2)
    for one in (first, second):
        assert [(t, [m.node for m in marks]) for t, marks in one.frames] == [
            (t, [m.node for m in marks]) for t, marks in lost.frames
        ]
    for a, b in ((first, second), (first, lost)):
        apart = [
            m.position - n.position
            for (_, one), (_, two) in zip(a.frames, b.frames, strict=True)
            for m, n in zip(one, two, strict=True)
        ]
        assert 0.1 * SD < np.sqrt(np.mean(np.square(apart))) < 10.0 * SD


def test_a_slope_is_shared_out_among_constants_of_a_kind():
    """Parabolas on two recordings: mean and covariance of their slopes, by information, and by their own curvature."""
    slopes = np.array([[1.0, 3.0, 0.5], [2.0, 4.0, 1.5]])
    alike = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    start, information, bend = np.array([0.3, 0.2, 0.1]), np.diag([3.0, 1.0, 7.0]), np.diag([2.0, 1.0, 3.0])
    both = [recorded(0), recorded(1)]

    def at(points, seen):
        return np.array(
            [(p - start) @ slopes[int(seen is both[1])] - 0.5 * (p - start) @ bend @ (p - start) for p in points]
        )

    found = slope_moments(at, both, start, information, alike)
    kinds = slopes @ alike.T * [6.0 / 5.0, 8.0 / 4.0]
    np.testing.assert_allclose(found.mean, np.array([0.75, 0.25, 1.0]) * kinds.mean(axis=0)[[0, 0, 1]])
    shared = np.array([[0.75, 0.0], [0.25, 0.0], [0.0, 1.0]])
    np.testing.assert_allclose(found.mean_cov, shared @ (np.cov(kinds.T) / 2.0) @ shared.T)


def test_recordings_that_leave_no_finite_likelihood_have_no_moments():
    with pytest.raises(CovarianceError, match=r"expected two or more of finite likelihood, found 0"):
        slope_moments(
            lambda points, _seen: np.full(len(points), -np.inf),
            [recorded(0)] * 3,
            np.zeros(1),
            np.eye(1),
            np.eye(1),
        )


def test_drag_is_less_wrong_on_average_where_forces_are_supposed_that_do_not_act():
    """Pokes supposed in a tenth of the frames, none acting: the likeliest drag is too large, centred less wrong.

    5 recordings of 3 s, the true drag given: the mean log is beyond 3 of its standard errors, centred within half
    of that: what is taken off is by two slopes, and one Newton step.
    """
    uncertainty = independent_uncertainty((Parameter("drag", 0),), [1.0])
    forces = Forces(WHITE, pokes=POKES)
    likeliest_logs, centred_logs = [], []

    def at(points, seen):
        return log_likelihoods([(of_drag(p[0]), forces) for p in points], seen)

    for seed in range(5):
        seen = recorded(seed, 91)
        precision = forced_pass(pendant(), uncertainty, seen, forces).information + np.eye(1)
        found = likeliest(lambda points, seen=seen: at(points, seen), lambda move: move, np.zeros(1), precision)
        assert found is not None
        recordings = simulated(of_drag(found.theta[0]), seen, forces)
        moments = slope_moments(at, recordings, found.theta, found.information, np.eye(1))
        likeliest_logs.append(found.theta[0])
        centred_logs.append((found.theta - np.linalg.solve(found.information + np.eye(1), moments.mean))[0])
    before = np.mean(likeliest_logs)
    assert before > 3.0 * np.std(likeliest_logs) / np.sqrt(5)
    assert abs(np.mean(centred_logs)) < 0.5 * before


def test_likelihoods_without_a_top_are_not_followed_far():
    """Slopes of 1,000 by a standard error, no curvature: asked for two standard errors on, and no farther."""
    asked = []

    def at(points, _seen):
        asked.extend(points)
        return 1000.0 * np.array(points)[:, 0]

    slope_moments(at, [recorded(0)] * 2, np.zeros(1), np.array([[24.0]]), np.eye(1))
    assert np.abs(asked).max() == pytest.approx((2.0 + 0.8) / 5.0, rel=0.1)
