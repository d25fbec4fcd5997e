"""A variance learnt while running: to what it is, no further than its bounds, and not where it plays no role."""

import numpy as np
import pytest

from estimators import VarianceScale

PART, REST = np.diag([2.0, 0.5]), np.array([[0.3, 0.1], [0.1, 0.2]])


def learnt(true, rng, n=4000, bounds=(0.01, 100.0), part=PART, rest=REST):
    """The scale after n innovations of covariance rest + true part, one each 1/30 s."""
    scales = VarianceScale(bounds)
    root = np.linalg.cholesky(rest + true * part)
    for _ in range(n):
        scales.learn(root @ rng.normal(size=2), part, rest, 1.0 / 30.0)
    return scales


@pytest.mark.parametrize("true", [0.2, 5.0])
def test_it_learns_the_variance_that_is_there(true):
    """Within 3 / sqrt(information) of its logarithm, which is what the Cramér-Rao bound leaves three sigma.

    30 frames/s and 10 s of memory are some 300 innovations of two coordinates. Mean of 4 seeds: a bias would show.
    20 s leave all but e^-2 of that information.
    """
    scales = [learnt(true, np.random.default_rng(seed), n=600) for seed in range(4)]
    logs = np.log([s.scale / true for s in scales])
    sigma = 1.0 / np.sqrt(scales[0].information)
    assert np.abs(logs).max() < 4.0 * sigma
    assert abs(logs.mean()) < 3.0 * sigma / np.sqrt(4) + 0.02  # 0.02: the start is worth ten coordinates at 1
    assert sigma < 0.12


def test_it_stays_within_its_bounds():
    rng = np.random.default_rng(0)
    assert learnt(100.0, rng, n=300, bounds=(0.25, 4.0)).scale == 4.0
    assert learnt(0.001, rng, n=3000, bounds=(0.25, 4.0)).scale == 0.25


def test_where_the_part_plays_no_role_nothing_is_learnt():
    """With the part a millionth of S the Fisher information of an innovation is below 1e-12; six sigma move nothing."""
    scales = VarianceScale((0.01, 100.0))
    for _ in range(300):
        scales.learn(np.array([6.0, 0.0]), 1e-6 * np.eye(2), np.eye(2), 1.0 / 30.0)
    assert scales.scale == pytest.approx(1.0, abs=5e-3)


def test_one_wild_innovation_moves_the_logarithm_by_one_at_most():
    scales = VarianceScale((1e-6, 1e6), start_information=0.1)
    scales.learn(np.array([1e3, 1e3]), PART, REST, 0.1)
    assert scales.scale == pytest.approx(np.e, rel=1e-12)


def test_what_is_old_is_forgotten():
    """After 50 s, five times forget_s, of innovations twice as wide the old ones weigh e^-5."""
    rng = np.random.default_rng(3)
    scales = learnt(1.0, rng, n=1500)
    root = np.linalg.cholesky(REST + 4.0 * PART)
    for _ in range(1500):
        scales.learn(root @ rng.normal(size=2), PART, REST, 1.0 / 30.0)
    assert scales.scale == pytest.approx(4.0, rel=0.35)


@pytest.mark.parametrize("bounds", [(0.0, 1.0), (2.0, 1.0), (-1.0, 1.0)])
def test_bounds_that_are_none_are_refused(bounds):
    with pytest.raises(ValueError, match="expected 0 < low <= high"):
        VarianceScale(bounds)
