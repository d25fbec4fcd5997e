"""The target as a linear map of the state: a node, a point at an offset, a point between nodes."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, NetworkError
from estimators import FixedLag, LeaveOneOut, OpenLoop, TargetPoint, TissueFilter, fixed_interval, target_map
from tests.estimators.conftest import followed, poked_frames

OFFSET = (0.012, -0.007)
BESIDE = TargetPoint((HIDDEN,), offset_m=OFFSET)
BETWEEN = TargetPoint(("M1", HIDDEN), (0.25, 0.75), OFFSET)


@pytest.fixture(scope="module")
def frames():
    """0.3 s of the poked phantom at 30 frames/s, marks to 2 mm: (time [s], marks)."""
    return poked_frames(0.3, 2e-3, 3)[0]


def tracked(phantom, frames, target):
    tissue = TissueFilter(phantom, target, OUTER)
    return tissue, followed(tissue, frames)[-1]


def outputs(phantom, frames, target):
    """Mean and covariance of the target by each output, covariance None where there is none."""
    tissue, estimate = tracked(phantom, frames, target)
    found = {"update": (estimate.mean, estimate.cov)}
    later = tissue.predict_at(tissue.time_s + 0.1)
    found["predict_at"] = later.mean, later.cov
    modes = tissue.predict_modes(tissue.time_s + 0.1)
    found["predict_modes"] = modes.means, modes.covs
    found["predict_path"] = tissue.predict_path(tissue.time_s + np.array([0.0, 0.1]))
    found["tables"] = tissue.tables(7, 1.0 / 30.0).parts(tissue)[-1][1:]
    smooth = fixed_interval(TissueFilter(phantom, target, OUTER), frames)[5]
    found["fixed_interval"] = smooth.mean, smooth.cov
    lag = FixedLag(TissueFilter(phantom, target, OUTER))
    lagged = [lag.take(*frame) for frame in frames][-1]
    found["FixedLag"] = lagged.mean, lagged.cov
    check, loop = LeaveOneOut(phantom, target, OUTER), OpenLoop(phantom, target)
    for time_s, marks in frames:
        check.predict(time_s)
        one, other = check.update(marks), loop.update(time_s, marks)
    found["LeaveOneOut"] = one.mean, one.cov
    found["OpenLoop"] = other.mean, None
    return found


def test_every_output_is_that_of_the_node_moved_by_the_offset(phantom, frames):
    """Means by the offset, covariances, shares and gain not at all. Rounding."""
    node, point = outputs(phantom, frames, HIDDEN), outputs(phantom, frames, BESIDE)
    for name, (mean, cov) in point.items():
        np.testing.assert_allclose(mean - node[name][0], np.broadcast_to(OFFSET, mean.shape), atol=1e-12, err_msg=name)
        if cov is not None:
            np.testing.assert_allclose(cov, node[name][1], rtol=1e-9, atol=1e-15, err_msg=name)
    (_, ours), (_, other) = tracked(phantom, frames, BESIDE), tracked(phantom, frames, HIDDEN)
    assert ours.gain == pytest.approx(other.gain, rel=1e-12)
    assert dict(ours.information_share) == pytest.approx(dict(other.information_share), rel=1e-12)


def test_a_point_between_nodes_has_the_moments_of_their_weighted_sum(phantom, frames):
    """H = 0.25 that of M1 + 0.75 that of M2: mean H x + offset, covariance H P H'; of the path, too. 1e-12."""
    tissue, estimate = tracked(phantom, frames, BETWEEN)
    x, P = tissue.filter.moments_by(tissue.filter.weights)
    H = 0.25 * tissue.process.node("M1") + 0.75 * tissue.process.node(HIDDEN)
    np.testing.assert_allclose(estimate.mean, H @ x + OFFSET, rtol=0, atol=1e-12)
    np.testing.assert_allclose(estimate.cov, H @ P @ H.T, rtol=1e-9, atol=1e-15)
    means, covs = tissue.predict_path([tissue.time_s])
    np.testing.assert_allclose(means[0], H @ x + OFFSET, rtol=0, atol=1e-12)
    np.testing.assert_allclose(covs[0], H @ P @ H.T, rtol=1e-9, atol=1e-15)
    assert estimate.gain is not None


def test_an_anchor_among_the_nodes_moves_with_nothing(phantom):
    """Half an anchor and half a node: half the node's covariance root, and the anchor's place in the constant."""
    anchor = next(name for name, fixed in zip(phantom.names, phantom.fixed, strict=True) if fixed)
    found = target_map(phantom, TargetPoint((anchor, HIDDEN), (0.5, 0.5)))
    np.testing.assert_allclose(found.constant, 0.5 * phantom.positions[phantom.index(anchor)], rtol=1e-15)
    np.testing.assert_array_equal(found.matrix[:, phantom.coordinates(HIDDEN)], 0.5 * np.eye(2))
    assert np.count_nonzero(found.matrix) == 2


def test_a_fix_is_of_the_point(phantom, frames):
    """A fix of the point moves the state as one of the node that lies the offset beside. Rounding."""
    (beside, estimate), (node, _) = tracked(phantom, frames, BESIDE), tracked(phantom, frames, HIDDEN)
    seen = estimate.mean + np.array([1e-3, 2e-3])
    beside.fix(seen, 1e-6 * np.eye(2))
    node.fix(seen - OFFSET, 1e-6 * np.eye(2))
    np.testing.assert_allclose(beside.filter.mean, node.filter.mean, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("wrong", "fault", "message"),
    [
        (lambda: TargetPoint(("M1", "M2"), (0.5, 0.6)), ValueError, "a sum of 1"),
        (lambda: TargetPoint(("M1", "M2")), ValueError, "different nodes, one weight each"),
        (lambda: TargetPoint(("M2",), offset_m=(1.0,)), ValueError, "expected 2 finite numbers"),
        (lambda: "M9", NetworkError, "M9"),
    ],
)
def test_what_is_no_point_of_the_tissue_is_rejected(phantom, wrong, fault, message):
    with pytest.raises(fault, match=message):
        target_map(phantom, wrong())
