"""The exponential of small matrices against SciPy's and against closed forms."""

import numpy as np
import pytest
from scipy.linalg import expm

from estimators.filters.exponential import small_expm


@pytest.mark.parametrize("n", [1, 2, 3, 6, 44])
@pytest.mark.parametrize("norm", [1e-8, 0.3, 0.5, 1.0, 2.0, 20.0])
def test_it_is_scipys(n, norm):
    """Padé there, Taylor here; each squaring doubles rounding: 1e-13 of the largest entry at a norm of 20."""
    A = np.random.default_rng(n).normal(size=(n, n))
    A *= norm / np.abs(A).sum(axis=1).max()
    expected = expm(A)
    np.testing.assert_allclose(small_expm(A), expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_of_nothing_it_is_one():
    np.testing.assert_array_equal(small_expm(np.zeros((3, 3))), np.eye(3))
