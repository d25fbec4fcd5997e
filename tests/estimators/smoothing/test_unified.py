"""The pass back over the moments of the unified filter, against filterpy's smoother; no tissue in it."""

import numpy as np
import pytest

from estimators.core.filter import HypothesisFilter
from estimators.smoothing.unified import smoothed_before
from tests.estimators.core.test_filter import Point, Seen, textbook


@pytest.mark.parametrize("kick", [None, np.array([0.2, -0.1])])
def test_of_one_mode_it_is_rauchs_smoother(kick):
    found, known = HypothesisFilter(Point([0.3])), textbook(0.09)
    known.R = np.array([[0.04]])
    filtered, expected, predicted = [], [], []
    found.trace = []
    for value in (0.3, 0.9, 1.1, 2.2):
        found.predict(0.5, kick)
        known.predict()
        if kick is not None:  # half of it acts before the motion
            known.x = known.x + 0.5 * (known.F @ kick[:, None] + kick[:, None])
        predicted.append(known.x.copy())
        found.update([Seen(value, 0.04)])
        known.update(value)
        filtered.append(found.moments_by(found.weights))
        expected.append((known.x.copy(), known.P.copy()))
    (mean, cov), (x, P) = filtered[-1], expected[-1]
    for k in (2, 1, 0):
        mean, cov = smoothed_before(mean, cov, found.trace[k + 1], np.array([], dtype=int))
        ahead = known.F @ expected[k][1] @ known.F.T + known.Q
        gain = expected[k][1] @ known.F.T @ np.linalg.inv(ahead)
        x = expected[k][0] + gain @ (x - predicted[k + 1])
        P = expected[k][1] + gain @ (P - ahead) @ gain.T
        np.testing.assert_allclose(mean, x.ravel(), rtol=1e-8)
        np.testing.assert_allclose(cov, P, rtol=1e-8)
    if kick is None:
        xs, Ps = (np.array(each) for each in zip(*expected, strict=True))
        smooth, covs, *_ = known.rts_smoother(xs, Ps)
        np.testing.assert_allclose(mean, smooth[0].ravel(), rtol=1e-8)
        np.testing.assert_allclose(cov, covs[0], rtol=1e-8)


def test_a_state_that_is_considered_stays():
    """Later observations correct it no more than earlier ones."""
    found = HypothesisFilter(Point([0.3]), considered=[1])
    found.trace = []
    for value in (0.3, 0.9):
        found.predict(0.5)
        found.update([Seen(value, 0.04)])
    mean, cov = smoothed_before(*found.moments_by(found.weights), found.trace[1], np.array([1]))
    assert mean[1] == found.trace[1].mean_before[1]
    assert mean[0] != found.trace[1].mean_before[0]
    assert cov[1, 1] == found.trace[1].cov_before[1, 1]
