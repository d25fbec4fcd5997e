"""What a recording does not determine keeps its value: closed forms of two and three constants."""

import numpy as np
import pytest

from estimators.identification.determined import ALIKE, keeping_undetermined, left_open
from estimators.identification.filter_pass import Pass
from estimators.identification.search import Optimum


@pytest.mark.parametrize(
    ("theta", "cov", "expected"),
    [
        ([0.3, -0.4], [[0.04, 0.0], [0.0, 0.3]], [0.3, -0.4]),  # both are determined
        ([0.3, -1.2], [[0.04, 0.0], [0.0, 0.9]], [0.3, 0.0]),  # one is not
        ([0.3, -1.2], [[0.9, 0.0], [0.0, 1.0]], [0.0, 0.0]),  # none is
        # the sum of two is, their difference is not: half of the sum each
        ([0.3, 0.5], [[0.52, -0.48], [-0.48, 0.52]], [0.4, 0.4]),
        # regression on what is kept: 0.3 - 0.08 / 0.9 * 1.2
        ([0.3, 1.2], [[0.04, 0.08], [0.08, 0.9]], [0.3 - 0.08 / 0.9 * 1.2, 0.0]),
    ],
)
def test_what_is_not_determined_keeps_its_value(theta, cov, expected):
    at, wide, _ = keeping_undetermined(np.array(theta), np.array(cov))
    np.testing.assert_allclose(at, expected, atol=1e-12)
    assert (at[np.array(expected) == 0.0] == 0.0).all()
    away = np.array(theta) - at
    assert np.linalg.eigvalsh(cov + np.outer(away, away) - wide)[0] > -1e-12
    assert np.linalg.eigvalsh(np.eye(2) + np.outer(at, at) - wide)[0] > -1e-12


def test_what_is_given_up_is_in_the_covariance():
    """A constant of variance 0.6 that is kept though found 0.5 off: 0.6 + 0.5²; what is determined is as it was."""
    _, wide, n_limited = keeping_undetermined(np.array([0.3, 0.5]), np.diag([0.04, 0.6]))
    np.testing.assert_allclose(wide, np.diag([0.04, 0.85]), atol=1e-12)
    assert n_limited == 0


def end(theta, log_likelihood, n=100):
    """Where a search ended, of n innovations."""
    found = Pass(np.zeros((n, 1)), np.eye(1), log_likelihood, np.zeros(n), np.ones(n), np.zeros((1, 1)))
    return Optimum(np.array(theta), found, found, 1, converged=True)


def test_ends_that_explain_the_recording_as_well_are_left_open():
    """Of 100 innovations, 10 in the log posterior: the prior's share counts, and an end far below does not."""
    best = end([0.0], 50.0)
    near, far = end([1.0], 50.0 + 0.5 - 100 * ALIKE + 0.1), end([-3.0], 50.0 + 4.5 - 100 * ALIKE - 0.1)
    np.testing.assert_allclose(left_open([best, near, far], best), [[0.5]])
    np.testing.assert_allclose(left_open([best], best), [[0.0]])
