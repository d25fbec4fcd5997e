"""The update by any marks of a frame, against the textbook's."""

from itertools import combinations

import numpy as np
import pytest

from dynamics import OUTER
from estimators import MarkMeasurement

MARK_SD = 4.14e-3
"""How well the paper's camera sees a mark, taken per axis [m]."""


def left(y: np.ndarray, S: np.ndarray, H: np.ndarray) -> float:
    """Squared residual of the least-squares fit of H b to y, both whitened by S."""
    whiten = np.linalg.inv(np.linalg.cholesky(S))
    fitted = np.linalg.lstsq(whiten @ H, whiten @ y)[0]
    return float(np.sum((whiten @ (y - H @ fitted)) ** 2))


@pytest.mark.parametrize("nodes", [some for n in range(4) for some in combinations(OUTER, n)])
def test_any_marks_are_taken_in_as_the_textbook_does(phantom, rest_state, marks_of, nodes, warmed):
    """Per mode K = P H' S⁻¹ on the rows of the marks that were seen, NIS by the mixture's moments. Rounding.

    In either order of the marks. Without any of them nothing changes and there is no NIS.
    """
    ours, rng = warmed(MARK_SD), np.random.default_rng(1)
    ours.predict(0.52)
    marks = marks_of(phantom, rest_state, MARK_SD, rng, nodes=nodes)
    marks = [MarkMeasurement(m.node, m.position, np.array([[2.0, 0.3], [0.3, 1.0]]) * 1e-5) for m in marks]
    rows = [i for node in nodes for i in range(8)[phantom.coordinates(node)]]
    H, R = np.eye(22)[rows], np.kron(np.eye(len(nodes)), np.array([[2.0, 0.3], [0.3, 1.0]]) * 1e-5)
    z = np.concatenate([m.position for m in marks]) if marks else np.empty(0)
    priors = [(f.x.copy(), f.P.copy()) for f in ours.mixture.filters]
    y, S = z - H @ ours.mixture.x, H @ ours.mixture.P @ H.T + R
    estimate = ours.update(marks)
    for f, (x, P) in zip(ours.mixture.filters, priors, strict=True):
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        np.testing.assert_allclose(f.x, x + K @ (z - H @ x), rtol=0, atol=1e-10)
        np.testing.assert_allclose(f.P, P - K @ H @ P, rtol=0, atol=1e-10)
    assert estimate.marks_used == len(nodes)
    assert estimate.nis == (pytest.approx(y @ np.linalg.inv(S) @ y, rel=1e-9) if nodes else None)
    if nodes:
        alone = [np.eye(len(y))[:, k : k + 2] for k in range(0, len(y), 2)]
        assert estimate.shift.n_marks == len(nodes)
        assert estimate.shift.nis == pytest.approx(left(y, S, sum(alone)), abs=1e-9)
        assert estimate.shift.nis_of_one == pytest.approx(min(left(y, S, H) for H in alone), abs=1e-9)
    else:
        assert estimate.shift is None
    other = warmed(MARK_SD)
    other.predict(0.52)
    np.testing.assert_allclose(other.update(marks[::-1]).mean, estimate.mean, rtol=0, atol=1e-12)


def test_two_calls_for_one_time_are_one_call_with_both(phantom, rest_state, marks_of, warmed):
    """Marks with independent noise may come one after the other: Bayes' rule. Mixed moments after each: rounding."""
    rng = np.random.default_rng(1)
    marks = marks_of(phantom, rest_state, MARK_SD, rng)
    ours, split = warmed(MARK_SD), warmed(MARK_SD)
    ours.predict(0.5)
    together = ours.update(marks)
    split.predict(0.5)
    split.update(marks[:1])
    split.predict(0.5)
    apart = split.update(marks[1:])
    np.testing.assert_allclose(apart.mean, together.mean, rtol=0, atol=1e-10)
    np.testing.assert_allclose(apart.cov, together.cov, rtol=0, atol=1e-12)
    assert apart.poked == pytest.approx(together.poked, abs=1e-10)
