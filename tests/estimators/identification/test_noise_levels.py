"""Noise levels from innovations alone: the levels that made the marks, within what the recording can tell."""

import numpy as np
import pytest

from dynamics import MassSpringNetwork, pack
from estimators import FilterSettings, ForceMode, MarkMeasurement, TissueFilter, tune_noise
from estimators.identification.noise_levels import log_likelihood, with_noise_levels, with_scaled_noise

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
    """12 s at 15 frames/s of white force of WHITE on both masses, by DOP853, the near mass seen to SD, said better."""
    rng = np.random.default_rng(5)
    start = pack(pair.positions[1:3], np.zeros((2, 2)))
    forces = 0.2 * WHITE * np.sqrt(120.0) * rng.normal(size=(12 * 120, 2, 2))
    states = driven(pair, start, forces)[::8]
    cov = (SD / TOLD) ** 2 * np.eye(2)
    return [
        (k / 15.0, [MarkMeasurement("near", state[:2] + rng.normal(0.0, SD, 2), cov)]) for k, state in enumerate(states)
    ]


@pytest.fixture(scope="module")
def tuned(pair, frames):
    return tune_noise(pair, frames, ("near",), "far")


@pytest.mark.slow
def test_the_level_that_made_the_marks_is_found(tuned):
    """White noise, told to be a third of what it is, within 20 %; marks, told to be 2.5 times as precise, within 40 %.

    Of the force some is taken for pokes, and what is left of it for noise of the marks.
    """
    white, _, marks = tuned.values
    assert abs(np.log(white / WHITE)) < 0.2
    assert tuned.log_sd[0] < 0.1
    assert abs(np.log(marks / TOLD)) < np.log(1.4)
    assert tuned.log_sd[2] < 0.1


def test_the_levels_found_are_more_probable_than_those_before_and_than_their_neighbours(pair, frames, tuned):
    def at(values):
        tissue = TissueFilter(pair, "far", ("near",), with_noise_levels(FilterSettings(), values))
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
