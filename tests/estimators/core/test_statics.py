"""Errors that last: constants, calibration, bias of fixes, the target's offset; considered or estimated."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, scale_parameters, stiffness_matrix
from dynamics.forces.parameters import Parameter, ParameterUncertainty, parameter_forces
from estimators import FilterSettings, MarkMeasurement, TissueFilter, normalised_error_squared
from estimators.core.discrepancy import Discrepancy
from estimators.core.disturbances import Disturbances
from estimators.core.statics import Statics
from estimators.core.tissue import TissueProcess
from estimators.process.process_model import FixBias
from estimators.process.target import TargetPoint
from tests.estimators.conftest import driven, followed, marks_of
from tests.estimators.core.bodies import two_masses

HZ = 1.0 / 30.0
EXACT = Discrepancy(levels=(3e-5,))
"""Nothing is left out of the equations, so that what errors that last do is seen."""

PUSHED = Disturbances(calm_m_s2=6.0, poke_m_s2=6.0, led_m_s2=6.0, slow_m_s2=(0.01,))
"""Forces of one strength all the time, so that the filter is linear."""
HELD = Disturbances(calm_m_s2=60.0, poke_m_s2=60.0, led_m_s2=60.0, slow_m_s2=(0.01,), short_s=1e3)
"""Forces that hardly change: where the body is, marks alone say."""


def deviation_of(network, kind, sd):
    """All constants of a kind off by the same share, one standard deviation."""
    own = tuple(Parameter(kind, k) for k in range(len(network.springs)))
    return ParameterUncertainty(own, np.full((1, len(own)), sd))


@pytest.mark.parametrize("kind", ["stiffness", "rest_length", "damping"])
def test_columns_of_constants_are_derivatives_of_the_motion_by_them(phantom, kind):
    """Truth: the same motion of networks whose constants are changed, by central differences."""
    sd, dt = 1e-3, HZ
    known = deviation_of(phantom, kind, sd)
    process = TissueProcess(phantom, OUTER, statics=Statics(known))
    rng = np.random.default_rng(0)
    state = process.prior(0.0)[0]
    state[process.parts["position"]] += 0.01 * rng.normal(size=8)
    state[process.parts["velocity"]] += 0.1 * rng.normal(size=8)
    moving = process.parts["velocity"].stop
    ends = []
    for sign in (1.0, -1.0):
        other = scale_parameters(phantom, known.parameters, sign * known.directions[0])
        ends.append(TissueProcess(other, OUTER).moved(state[:-1], dt)[:moving])
    truth = 0.5 * (ends[0] - ends[1])
    found = process.linearize(state, dt).matrix[:moving, process.parts["constants"]].ravel()
    for part in (slice(0, moving // 2), slice(moving // 2, moving)):
        assert np.linalg.norm(found[part] - truth[part]) < 0.15 * np.linalg.norm(truth[part])


def rest_marks(network, sd_m=1e-3, seed=None, by_m=0.0, shared=None):
    rng, marks = np.random.default_rng(seed), []
    for node in OUTER:
        place = network.positions[network.index(node)] + by_m
        noise = 0.0 if seed is None else sd_m * rng.normal(size=2)
        marks.append(MarkMeasurement(node, place + noise, sd_m**2 * np.eye(2), shared))
    return marks


def seen(tissue, seconds, marks_at, start=0):
    return followed(tissue, [(k * HZ, marks_at(k)) for k in range(start, start + round(seconds / HZ))])[-1]


def spread(estimate):
    return float(np.sqrt(np.trace(estimate.cov)))


def test_a_body_whose_stiffness_is_off_by_a_deviation_is_covered_where_that_is_stated(phantom):
    """Springs 20 % softer, one mark led to and fro: errors are within two deviations of what is stated."""
    known = deviation_of(phantom, "stiffness", 0.2)
    body = scale_parameters(phantom, known.parameters, -known.directions[0])
    forces = np.zeros((240, 4, 2))
    forces[:, 0] = phantom.masses[0] * 6.0 * np.sin(2.0 * np.pi * np.arange(240) / 120.0)[:, None] * [1.0, 0.3]
    start = np.concatenate([phantom.positions[phantom.free].ravel(), np.zeros(8)])
    states = driven(body, start, forces)[::4]
    frames = [marks_of(phantom, state, 3e-4, np.random.default_rng(k)) for k, state in enumerate(states)]
    at, ratios = phantom.coordinates(HIDDEN), {}
    for stated in (None, known):
        tissue = TissueFilter(phantom, HIDDEN, OUTER, uncertainty=stated, discrepancy=EXACT, disturbances=PUSHED)
        found = followed(tissue, [(k * HZ, marks) for k, marks in enumerate(frames)])[15:]
        errors = np.array([one.mean for one in found]) - states[15:, at]
        squared = normalised_error_squared(errors, [one.cov for one in found])
        ratios[stated is not None] = np.mean(squared < 5.991), np.mean([spread(one) for one in found])
    assert ratios[True][0] > 0.9
    assert ratios[False][0] < 0.6
    assert ratios[True][1] > 1.1 * ratios[False][1]


def schmidt(mean, P, H, R, y, considered):
    """The textbook's update: gain of considered states nought, covariance by Joseph's form."""
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    K[considered] = 0.0
    left = np.eye(len(P)) - K @ H
    return mean + K @ y, left @ P @ left.T + K @ R @ K.T


def test_an_update_is_schmidts_and_leaves_considered_states(phantom):
    """Of each mode that is not left out: mean and covariance by the textbook, definite, considered states as before."""
    shared = np.array([[2e-3, 0.0], [0.0, 1e-3]])
    tissue = TissueFilter(
        phantom, HIDDEN, OUTER, uncertainty=deviation_of(phantom, "stiffness", 0.2), n_calibration=2, discrepancy=EXACT
    )
    own = tissue.process.considered
    for k in range(20):
        tissue.predict(k * HZ)
        marks = rest_marks(phantom, seed=k, shared=shared)
        covs, before, places = tissue.filter.covs, tissue.filter.state(), tissue.places(marks)
        tissue.update(marks)
        assert not tissue.filter.outlying.any()
        if k in (0, 19):
            modes = np.flatnonzero(tissue.filter.weights)
            assert len(modes) > 1
            means = before["means"]
            for mode in modes:
                predicted, H = places.linearize(means[mode])
                mean, cov = schmidt(means[mode], covs[mode], H, places.cov, places.value - predicted, own)
                np.testing.assert_allclose(tissue.filter.means[mode], mean, atol=1e-9)
                np.testing.assert_allclose(tissue.filter.covs[mode], cov, atol=1e-9 * np.abs(cov).max())
    assert len(own) == 3
    assert np.array_equal(tissue.filter.means[:, own], np.zeros((len(before["weights"]), 3)))
    covs = tissue.filter.covs[modes]
    np.testing.assert_allclose(covs[:, own][:, :, own], np.tile(np.eye(3), (len(modes), 1, 1)), atol=1e-9)
    values = np.linalg.eigvalsh(covs)
    assert (values[:, 0] > -1e-12 * values[:, -1]).all()


def test_an_error_that_lasts_is_not_averaged_away_and_one_new_in_each_frame_is(phantom):
    """All marks off together by 5 mm, one deviation, for 1 s: its share of the error is covered where it lasts."""
    shared, ends = 5e-3 * np.eye(2), {}
    for n_calibration in (0, 2):
        tissue = TissueFilter(phantom, HIDDEN, OUTER, n_calibration=n_calibration, discrepancy=EXACT, disturbances=HELD)
        ends[n_calibration] = seen(tissue, 1.0, lambda k: rest_marks(phantom, 3e-4, k, by_m=5e-3, shared=shared))
        columns = tissue.by_calibration
    assert columns.shape == (2, 2)
    assert np.linalg.norm(columns) > 4e-3
    assert np.all(np.linalg.eigvalsh(ends[2].cov - columns @ columns.T) > 0.0)
    assert spread(ends[0]) < 0.3 * spread(ends[2])
    error = ends[2].mean - phantom.positions[phantom.index(HIDDEN)]
    assert np.linalg.norm(error) > 3e-3
    assert error @ np.linalg.solve(ends[2].cov, error) < 5.991


def test_a_camera_that_is_off_moves_the_target_against_its_column(phantom):
    """The column is of the truth about the mean; truth: the same marks moved by one deviation of the error."""
    shared, ends = np.array([[3e-3], [1e-3]]), []
    for by in (0.0, 1.0):
        tissue = TissueFilter(phantom, HIDDEN, OUTER, n_calibration=1, discrepancy=EXACT, disturbances=PUSHED)
        marks = [
            replace(mark, position=mark.position + by * shared[:, 0]) for mark in rest_marks(phantom, shared=shared)
        ]
        ends.append((seen(tissue, 1.0, lambda _k, marks=marks: marks).mean, tissue.by_calibration[:, 0]))
    moved = ends[1][0] - ends[0][0]
    np.testing.assert_allclose(-ends[0][1], moved, atol=0.03 * np.linalg.norm(moved))


def test_fixes_do_not_shrink_the_target_below_their_bias(phantom):
    """Of the target's offset, 10 mm, a hundred fixes of 1 mm with a bias of 4 mm leave 4 / sqrt(1 + 0.16) mm."""
    target = TargetPoint((HIDDEN,), sd_m=1e-2)
    sigmas = {}
    for name, bias in (("biased", FixBias(4e-3, 1e9)), ("exact", None)):
        tissue = TissueFilter(phantom, target, OUTER, FilterSettings(fix_bias=bias), discrepancy=EXACT)
        found = seen(tissue, 0.3, lambda k: rest_marks(phantom, 1e-4, k))
        place = found.mean + np.array([3e-3, 0.0])
        for _ in range(100):
            found = tissue.fix(place, 1e-6 * np.eye(2))
        sigmas[name] = np.sqrt(np.diag(found.cov)), found.mean - place
    np.testing.assert_allclose(sigmas["biased"][0], 4e-3 / np.sqrt(1.16), rtol=0.03)
    assert sigmas["exact"][0].max() < 3e-4
    assert np.linalg.norm(sigmas["exact"][1]) < 1e-4
    assert np.linalg.norm(sigmas["biased"][1]) == pytest.approx(3e-3 * 0.16 / 1.16, rel=0.1)


def test_a_bias_that_varies_lets_later_fixes_say_more(phantom):
    """Fixes ten correlation times apart are as good as independent ones."""
    settings = FilterSettings(fix_bias=FixBias(4e-3, 0.03))
    tissue = TissueFilter(phantom, TargetPoint((HIDDEN,), sd_m=1e-2), OUTER, settings, discrepancy=EXACT)
    for k in range(30):
        tissue.predict(k * HZ)
        found = tissue.update(rest_marks(phantom, 1e-4, k))
        if k % 10 == 9:
            found = tissue.fix(found.mean, 1e-8 * np.eye(2))
    assert np.sqrt(found.cov[0, 0]) == pytest.approx(4e-3 / np.sqrt(3.0 + 0.16), rel=0.05)


@pytest.mark.parametrize("stiffness", [20.0, 2000.0, 30000.0])
def test_an_error_of_the_stiffness_counts_alike_in_soft_and_stiff_bodies(stiffness):
    """Weight by the stiffness, so that all sag alike: the effect that lasts is -K^-1 dF/dlog k, to 0.1 %."""
    network = two_masses(stiffness, 9.81 * stiffness / 500.0)
    known = deviation_of(network, "stiffness", 0.3)
    process = TissueProcess(network, ["y"], statics=Statics(known))
    state = np.zeros(process.n)
    state[process.parts["position"]] = process.coordinates(network.positions)
    A, moving = process.linearize(state, HZ).matrix, process.parts["velocity"].stop
    found = np.linalg.solve(np.eye(moving) - A[:moving, :moving], A[:moving, process.parts["constants"]])[:6, 0]
    forces = known.directions @ parameter_forces(
        network, known.parameters, network.positions, np.zeros_like(network.positions)
    )
    expected = np.linalg.solve(stiffness_matrix(network, network.positions), forces.ravel())
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())
