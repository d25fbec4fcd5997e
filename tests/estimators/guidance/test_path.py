"""The path in two parts, nobody pokes until then and all else: each against the filter, and a hit by both."""

import gc
from dataclasses import replace
from functools import partial
from weakref import ref

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import (
    GaussianMixture,
    Needle,
    PathParts,
    TargetPath,
    TissueFilter,
    advise,
    guide,
    hit_probability,
    path_by_tables,
    path_near_rest,
    path_tables,
)
from estimators.core.disturbances import Disturbances
from tests.estimators.conftest import followed, resting_frames
from tests.estimators.guidance.straight_down import DISC, DOWN, NOW_S

FRAME_S = 1.0 / 30.0
NEVER_S = 1e12


def resting(phantom, shift=0.0):
    """A filter after 20 frames of a phantom at rest, its outer marks seen so far aside [m]."""
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    followed(tissue, resting_frames(phantom, 20, 1e-3, by=[shift, 0.0]))
    return tissue


@pytest.fixture(scope="module")
def tissue(phantom):
    return resting(phantom)


@pytest.fixture(scope="module")
def tables(tissue):
    return path_tables(tissue, 1.0)


def test_both_parts_together_are_the_whole(tissue, tables):
    """First and second moments of the mixture at each time, by their definition: rounding."""
    path = path_by_tables(tables, tissue)
    weights, means, covs = path.mixture.weights, path.mixture.means, path.mixture.covs
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    whole = np.einsum("kc,kcd->kd", weights, means)
    np.testing.assert_allclose(whole, path.means, atol=1e-12)
    second = covs + means[..., :, None] * means[..., None, :]
    own = np.einsum("kc,kcde->kde", weights, second) - whole[:, :, None] * whole[:, None, :]
    np.testing.assert_allclose(own, path.covs, atol=1e-9 * path.covs.max())
    assert (np.linalg.eigvalsh(covs) > 0.0).all()


def test_the_part_in_which_nobody_pokes_is_that_of_a_filter_that_knows_it(phantom, tissue, tables):
    """The same state under a chain in which no force grows: means within 0.2 sigma, sigmas within 10 %."""
    never = Disturbances(calm_s=NEVER_S, led_each_s=NEVER_S, rise_s=NEVER_S)
    knowing = TissueFilter(phantom, HIDDEN, OUTER, disturbances=never)
    now, calm = tissue.snapshot(), tissue.process.disturbances.calm_modes
    before = now.filter["weights"]
    weights = np.where(calm, before, 0.0) / before[calm].sum()
    knowing.restore(replace(now, filter={**now.filter, "weights": weights}))
    path = path_by_tables(tables, tissue)
    exact, covs = knowing.predict_path(path.times_s)
    sigma, own = (np.sqrt(np.trace(c, axis1=1, axis2=2)) for c in (covs, path.mixture.covs[:, 0]))
    assert (np.linalg.norm(path.mixture.means[:, 0] - exact, axis=1)[1:] < 0.2 * sigma[1:]).all()
    np.testing.assert_allclose(own[1:], sigma[1:], rtol=0.1)
    # while the whole, in which somebody may poke, is much wider
    assert np.sqrt(np.trace(path.covs[-1])) > 2.0 * sigma[-1]


def test_a_hit_is_judged_part_by_part():
    """By `hit_probability` of the mixture where the needle arrives; a Gaussian of its moments gives less."""
    times = NOW_S + FRAME_S * np.arange(121)
    means, variances = np.array([[0.0, 0.04], [-0.009, 0.04]]), np.array([1e-6, 64e-6])
    parts = GaussianMixture(np.array([0.9, 0.1]), means, variances[:, None, None] * np.eye(2))
    mean = parts.weights @ parts.means
    away = parts.means - mean
    cov = np.einsum("c,cde->de", parts.weights, parts.covs + away[:, :, None] * away[:, None, :])
    mixture = PathParts(*(np.tile(each, (121, *[1] * each.ndim)) for each in (parts.weights, parts.means, parts.covs)))
    needle = Needle()
    path = TargetPath(times, np.tile(mean, (121, 1)), np.tile(cov, (121, 1, 1)), mixture)
    found = advise(path, DOWN, DISC, needle=needle)
    deep = found.depth_m + DOWN.depth_m
    tip = GaussianMixture.gaussian(DOWN.entry + deep * DOWN.axis, needle.tip_cov(DOWN.axis, deep))
    expected = hit_probability(parts, tip, DOWN.axis, DISC, needle=needle)
    assert found.probability == pytest.approx(expected, abs=1e-9)
    assert found.probability > advise(replace(path, mixture=None), DOWN, DISC, needle=needle).probability + 0.1


def test_tables_are_used_near_rest_and_as_far_as_they_reach_else_the_filter(phantom, tissue, tables):
    times = tissue.time_s + FRAME_S * np.arange(20)
    near = path_near_rest(tables, tissue, times)
    assert near.mixture is not None
    np.testing.assert_allclose(near.times_s, times, atol=1e-9)
    far = tissue.time_s + FRAME_S * np.arange(40)
    assert path_near_rest(tables, tissue, far).mixture is None
    pushed = resting(phantom, shift=0.12)
    turned = path_near_rest(path_tables(pushed, 1.0), pushed, times)
    assert turned.mixture is None
    np.testing.assert_array_equal(turned.means, pushed.predict_path(times)[0])


def test_guide_goes_by_tables_that_are_made_once(phantom, monkeypatch):
    """As `softaim advise` has it, now and for a needle that starts later; what they reach is not made again."""
    own = resting(phantom)
    estimate = own.predict_at(own.time_s)
    estimate = replace(estimate, nis=1.0)
    tables = path_tables(own, 4.0)
    down = replace(DOWN, entry=estimate.mean + np.array([0.0, 0.06]))
    made = []
    monkeypatch.setattr("estimators.guidance.path.path_tables", lambda *at: made.append(at) or tables)
    monkeypatch.setattr(TissueFilter, "predict_path", lambda _own, _times_s: pytest.fail("not by tables"))
    for now_s in (None, own.time_s + 0.05):
        found = guide(own, estimate, down, DISC, now_s=now_s)
        expected = guide(own, estimate, down, DISC, now_s=now_s, path_at=partial(path_near_rest, tables, own))
        assert found.probability is not None
        assert (found.advice, found.probability) == (expected.advice, expected.probability)
        np.testing.assert_array_equal(found.aim, expected.aim)
    assert len(made) == 1


def test_tables_that_guide_has_made_go_with_their_filter(phantom):
    own = resting(phantom)
    guide(own, own.predict_at(own.time_s), replace(DOWN, entry=own.place_of(own.target)[0] + [0.0, 0.06]), DISC)
    gone = ref(own)
    del own
    gc.collect()
    assert gone() is None


@pytest.mark.parametrize(
    "shapes", [((3, 2), (3, 2, 2), (3, 1, 2, 2)), ((2, 2), (2, 2, 2), (2, 2, 2, 2)), ((3,), (3, 2), (3, 2, 2))]
)
def test_parts_of_another_shape_are_refused(shapes):
    parts = PathParts(*map(np.zeros, shapes))
    with pytest.raises(ValueError, match=r"path mixture: expected weights \(3, c\), means \(3, c, 2\), covs"):
        TargetPath(np.arange(3.0), np.zeros((3, 2)), np.zeros((3, 2, 2)), parts)
