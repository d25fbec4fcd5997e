"""Scores of known numbers."""

import numpy as np
import pytest

from experiments.studies.zoo.scores import hidden_scores, mean_distance


def scored(errors, sd, *, tracking=True, size_m=1.0):
    means = np.asarray(errors, dtype=float)[:, None]
    covs = np.tile(sd**2 * np.eye(2), (len(means), 1, 1, 1))
    return hidden_scores(means, covs, np.zeros_like(means), tracking=np.full(len(means), tracking), size_m=size_m)


def test_errors_and_nees_of_known_numbers():
    """Errors of 3 and 4 sd: NEES by degree of freedom (9 + 16) / 2 / 2, region of 95 % up to 2.45 sd."""
    found = scored([[0.03, 0.0], [0.0, 0.04], [0.01, 0.0], [0.0, 0.0]], 0.01)
    assert found["error_m"] == pytest.approx(0.02)
    assert found["rms_m"] == pytest.approx(np.sqrt((9 + 16 + 1) / 4) * 0.01)
    assert found["nees"] == pytest.approx((9 + 16 + 1) / 4 / 2)
    assert found["covered"] == 0.5
    assert (found["non_finite"], found["wrong_tracking"]) == (0, 0)


def test_tracking_is_wrong_beyond_both_five_sigma_and_a_tenth_of_the_size():
    errors = [[0.2, 0.0], [0.09, 0.0], [0.04, 0.0]]
    assert scored(errors, 0.01)["wrong_tracking"] == 1
    assert scored(errors, 0.05)["wrong_tracking"] == 0
    assert scored(errors, 0.01, tracking=False)["wrong_tracking"] == 0
    assert scored(errors, 0.01, size_m=0.5)["wrong_tracking"] == 2


def test_what_is_not_finite_or_not_definite_is_counted_and_never_covered():
    means = np.zeros((4, 1, 2))
    covs = np.tile(np.eye(2), (4, 1, 1, 1))
    means[0, 0, 0] = np.nan
    covs[1, 0, 0, 0] = np.inf
    covs[2, 0, 1, 1] = -1.0
    found = hidden_scores(means, covs, np.zeros_like(means), tracking=np.ones(4, dtype=bool), size_m=1.0)
    assert found["non_finite"] == 3
    assert found["covered"] == 0.25
    assert found["error_m"] == np.inf


def test_a_reference_that_runs_away_is_infinitely_wrong():
    places = np.zeros((2, 1, 3))
    assert mean_distance(np.tile([3.0, 4.0, 0.0], (2, 1, 1)), places) == pytest.approx(5.0)
    assert mean_distance(np.full((2, 1, 3), np.nan), places) == np.inf
