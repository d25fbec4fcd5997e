"""Noise levels from innovations alone: the levels that made the marks, within what the recording can tell."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import MassSpringNetwork, pack
from estimators import FilterSettings, ForceMode, MarkMeasurement, TissueFilter, tune_noise
from estimators.identification import noise_levels
from estimators.identification.budget import Budget
from estimators.identification.noise_levels import (
    PART,
    PRIOR_LOG_SD,
    STRAINS,
    _Cost,
    _Passes,
    _search,
    log_likelihood,
    with_noise_levels,
    with_scaled_noise,
)
from tests.estimators.identification.test_pendulum import by_post

SD = 0.0005
WHITE = 0.12
TOLD = 2.5
"""How much more precise the marks are said to be."""


@pytest.fixture(scope="module")
def pair():
    """Two masses between two anchors in a row, drag and dashpots, no gravity: quick to follow."""
    positions = np.array([[0.0, 0.0], [0.1, 0.0], [0.2, 0.0], [0.3, 0.0]])
    springs = np.array([[0, 1], [1, 2], [2, 3]])
    return MassSpringNetwork(
        names=("A", "near", "far", "B"),
        positions=positions,
        masses=np.full(4, 0.2),
        fixed=np.array([True, False, False, True]),
        drag=np.array([0.0, 0.3, 0.3, 0.0]),
        friction=np.zeros(4),
        springs=springs,
        stiffness=np.full(3, 40.0),
        rest_lengths=np.full(3, 0.08),
        damping=np.full(3, 0.2),
        gravity=np.zeros(2),
    )


@pytest.fixture(scope="module")
def frames(pair, driven):
    """7 s at 15 frames/s of white force of WHITE on both masses, by DOP853, the near mass seen to SD, said better."""
    rng = np.random.default_rng(5)
    start = pack(pair.positions[1:3], np.zeros((2, 2)))
    forces = 0.2 * WHITE * np.sqrt(120.0) * rng.normal(size=(7 * 120, 2, 2))
    states = driven(pair, start, forces)[::8]
    cov = (SD / TOLD) ** 2 * np.eye(2)
    return [
        (k / 15.0, [MarkMeasurement("near", state[:2] + rng.normal(0.0, SD, 2), cov)]) for k, state in enumerate(states)
    ]


@pytest.fixture(scope="module")
def tuned(pair, frames):
    return tune_noise(pair, frames, ("near",), "far", workers=by_post)


def test_the_level_that_made_the_marks_is_found(tuned):
    """White noise, told to be a third of what it is, within 30 %; marks, told to be 2.5 times as precise, within 40 %.

    Of the force some is taken for pokes, and what is left of it for noise of the marks. Of 12 s it was within 20 %:
    standard errors go by the root of the time.
    """
    white, _, marks = tuned.values
    assert abs(np.log(white / WHITE)) < 0.26
    assert tuned.log_sd[0] < 0.13
    assert abs(np.log(marks / TOLD)) < np.log(1.4)
    assert tuned.log_sd[2] < 0.14


def test_the_levels_found_are_more_probable_than_those_before_and_than_their_neighbours(pair, frames, tuned):
    def at(values):
        settings = with_noise_levels(FilterSettings(white_bounds=(1.0, 1.0)), values)
        tissue = TissueFilter(pair, "far", ("near",), settings)
        return log_likelihood(tissue, with_scaled_noise(frames, values[2]))

    assert tuned.log_likelihood == pytest.approx(at(tuned.values), rel=1e-9)
    assert tuned.log_likelihood_before == pytest.approx(at([0.043, 5.0, 1.0]), rel=1e-9)
    assert tuned.log_likelihood > tuned.log_likelihood_before + 5.0
    for factor in (0.6, 1.6):
        assert tuned.log_likelihood > at(tuned.values * [factor, 1.0, 1.0]) + 0.5


def test_what_no_recording_tells_stays_within_its_prior(tuned):
    """Nobody pokes here: the poke's level is left within a few of the prior's log 2, its error near that."""
    assert abs(np.log(tuned.values[1] / 5.0)) < 2.0
    assert tuned.log_sd[1] > 0.3


def test_settings_carry_the_levels_and_nothing_else(tuned):
    usual, found = FilterSettings(), tuned.settings
    assert found.quiet == ForceMode(tuned.values[0], usual.quiet.poke * tuned.values[0] / usual.quiet.white, 0.05)
    assert found.poked == ForceMode(tuned.values[0], tuned.values[1], usual.poked.lasting_s)
    assert found.calm_s == usual.calm_s
    assert tuned.marks == tuned.values[2]


def test_likelihood_is_that_of_the_textbook_filter(pair, frames):
    """One mode in the small is a Kalman filter: sum of log N(innovation; 0, S), the first frame left out.

    Here with the filter's own innovations, mode by mode: log sum of mu_j N_j. Rounding.
    """
    tissue = TissueFilter(pair, "far", ("near",))
    total = 0.0
    for k, (time_s, marks) in enumerate(frames[:40]):
        tissue.predict(time_s)
        mixture = tissue.mixture
        densities = []
        for f in mixture.filters:
            S = f.P[:2, :2] + marks[0].cov
            y = marks[0].position - f.x[:2]
            densities.append(np.exp(-0.5 * y @ np.linalg.solve(S, y)) / (2.0 * np.pi * np.sqrt(np.linalg.det(S))))
        if k:
            total += np.log(mixture.mu @ densities)
        tissue.update(marks)
    assert log_likelihood(TissueFilter(pair, "far", ("near",)), frames[:40]) == pytest.approx(total, rel=1e-10)


PLACE, INFORMATION = np.array([-0.8, 0.3, 0.6]), np.array([40.0, 5.0, 900.0])


def parabola(logs):
    """Log likelihood of all frames, as sharp as INFORMATION about PLACE."""
    return -0.5 * float(INFORMATION @ (logs - PLACE) ** 2)


def counted(run, share=1.0):
    return _Cost(run, lambda _share: None, share)


def test_a_part_of_the_frames_is_searched_first():
    """Posterior of a parabola in closed form; after the part's search two steps through all frames suffice."""
    alone, cost = counted(parabola), counted(parabola)
    _search(alone, None)
    errors = _search(cost, counted(lambda logs: PART * parabola(logs), PART))
    precision = INFORMATION + PRIOR_LOG_SD**-2.0
    assert np.abs((cost.best - INFORMATION * PLACE / precision) * np.sqrt(precision)).max() < 0.3
    np.testing.assert_allclose(errors, 1.0 / np.sqrt(precision), rtol=1e-6)
    assert cost.passes < alone.passes


def test_a_part_that_is_not_finite_is_left_out():
    alone, cost = counted(parabola), counted(parabola)
    expected = _search(alone, None)
    np.testing.assert_allclose(_search(cost, counted(lambda _logs: -np.inf, PART)), expected, rtol=1e-9)
    np.testing.assert_allclose(cost.best, alone.best, atol=1e-9)


def test_after_the_most_passes_the_best_is_kept_and_errors_are_those_of_the_prior(monkeypatch):
    monkeypatch.setattr(noise_levels, "MOST_PASSES", 10)
    cost = counted(lambda logs: -50.0 * float(np.abs(logs - 2.0).sum()))
    np.testing.assert_array_equal(_search(cost, None), np.full(3, PRIOR_LOG_SD))
    assert cost.passes == 10
    assert cost.least < 300.0
    assert (cost.best > 0.0).all()


def two_ways(run, logs):
    """Log likelihood where a strain of 1 % is the better by the levels before, and no strain by others, by far."""
    place, height = WAYS[run.settings.strain_sd > 0.0]
    between = 100.0 * (run.settings.strain_sd not in (0.0, 0.01))
    return height - between - 20.0 * float(((logs - place) ** 2).sum())


WAYS = {True: (np.array([0.0, -0.6, 0.0]), 20.0), False: (np.array([0.3, 1.2, 0.0]), 40.0)}
"""By whether there is a strain: the levels that explain most, in logs, and the log likelihood there."""


@pytest.mark.parametrize("higher", [True, False])
def test_levels_are_searched_without_a_strain_too(pair, monkeypatch, higher):
    """By the levels before a strain is the likelier, 12.8 and 9.4; each by its own levels it is not where `higher`."""
    monkeypatch.setitem(WAYS, False, (WAYS[False][0], 40.0 if higher else 19.0))
    monkeypatch.setattr(noise_levels._Passes, "__call__", two_ways)
    stiff = replace(pair, damping=np.full(3, 30.0))
    marks = [MarkMeasurement(node, stiff.positions[stiff.index(node)], SD**2 * np.eye(2)) for node in ("near", "far")]
    found = tune_noise(stiff, [(k / 15.0, marks) for k in range(10)], ("near", "far"), "far")
    place, height = WAYS[not higher]
    assert found.settings.strain_sd == (0.0 if higher else 0.01)
    assert found.settings.least_white == (0.0, 0.0)
    # the parabola's posterior: its place by the prior's precision beside its own, 40
    start = np.array([FilterSettings().quiet.white, FilterSettings().poked.poke, 1.0])
    expected = place * 40.0 / (40.0 + PRIOR_LOG_SD**-2.0)
    np.testing.assert_allclose(np.log(found.values / start), expected, atol=0.1)
    assert found.log_likelihood == pytest.approx(height, abs=1.0)


@pytest.mark.parametrize(("off", "least", "most"), [(0.0, 0.0, 0.001), (0.03, 0.003, 0.01)])
def test_how_far_springs_of_a_stiff_body_may_be_off_is_found(pair, driven, off, least, most):
    """3 s of white force, both masses seen to SD; the model's first spring is right, or 3 % too long, 2 mm of sag.

    By the levels that act. A strain of 1 % where there is none would be 1 mm at once, twice what the marks scatter.
    """
    stiff, rng = replace(pair, damping=np.full(3, 30.0)), np.random.default_rng(7)
    start = pack(pair.positions[1:3], np.zeros((2, 2)))
    states = driven(stiff, start, 0.2 * WHITE * np.sqrt(120.0) * rng.normal(size=(3 * 120, 2, 2)))[::8]
    frames = []
    for k, state in enumerate(states):
        places = state[:4].reshape(2, 2) + rng.normal(0.0, SD, (2, 2))
        seen = zip(("near", "far"), places, strict=True)
        frames.append((k / 15.0, [MarkMeasurement(node, place, SD**2 * np.eye(2)) for node, place in seen]))
    believed = replace(stiff, rest_lengths=stiff.rest_lengths * [1.0 + off, 1.0, 1.0])
    settings = FilterSettings(white_bounds=(1.0, 1.0))
    levels, none = np.array([WHITE, settings.poked.poke, 1.0]), np.zeros(3)
    run = _Passes(believed, (("near", "far"), "far"), None, settings, levels, frames, Budget())
    by_strain = run.of_strains(none, run(none), map)
    assert set(by_strain) == set(STRAINS)
    assert least <= max(by_strain, key=by_strain.__getitem__) <= most
