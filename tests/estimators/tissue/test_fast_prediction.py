"""Paths by tables against the filter's own predictions, which take a hundred times as long."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, independent_uncertainty, parameters, rest_shape
from estimators import FilterSettings, TissueFilter, fast_prediction_tables, predict_fast
from estimators.tissue.fast_prediction import moments_ahead, moments_now

FRAME_S = 4 / 120.0


def followed(phantom, rest_state, driven, poke_forces, marks_of):
    """A filter that follows a poked phantom, given at every tenth frame from the second on."""
    rng = np.random.default_rng(4)
    states = driven(phantom, rest_state, poke_forces(phantom, 4.0, rng))
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    for k, state in enumerate(states[::4]):
        tissue.predict(k * FRAME_S)
        tissue.update(marks_of(phantom, state, 4.14e-3, rng))
        if k >= 30 and k % 10 == 0:
            yield tissue


def test_a_path_is_that_of_the_filter(phantom, rest_state, driven, poke_forces, marks_of):
    """Up to 1 s ahead, ten times of a poked run: means within 30 % of sigma, 8 % on average; sigma within 25 %, 9 %.

    What is left is that springs turn and friction is not a dashpot.
    """
    means_off, sigmas_off, tables = [], [], None
    for tissue in followed(phantom, rest_state, driven, poke_forces, marks_of):
        tables = fast_prediction_tables(tissue, 1.0) if tables is None else tables
        times, means, covs = predict_fast(tables, tissue)
        exact, exact_covs = tissue.predict_path(times)
        sigma, own = (np.sqrt(np.trace(c, axis1=1, axis2=2)) for c in (exact_covs, covs))
        means_off.append(np.linalg.norm(means - exact, axis=1) / sigma)
        sigmas_off.append(np.abs(own / sigma - 1.0))
        np.testing.assert_allclose(means[0], exact[0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(covs[0], exact_covs[0], rtol=1e-6, atol=1e-12)
    assert len(means_off) == 10
    assert np.max(means_off) < 0.3
    assert np.mean(means_off) < 0.08
    assert np.max(sigmas_off) < 0.25
    assert np.mean(sigmas_off) < 0.09


def test_under_a_steady_push_it_comes_to_rest_where_the_tissue_does(phantom):
    """0.3 N on the hidden mass, after 4 s: `rest_shape` under it, 2 % for the second order."""
    force = np.zeros((len(phantom.free), 2))
    force[phantom.free.tolist().index(phantom.index(HIDDEN))] = [0.3, -0.1]
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    tissue.predict(0.0)
    tables = fast_prediction_tables(tissue, 4.0)
    _, means, _ = predict_fast(tables, tissue, np.tile(force, (tables.n_times - 1, 1, 1)))
    here = phantom.index(HIDDEN)
    exact = rest_shape(phantom, force)[here] - rest_shape(phantom)[here]
    np.testing.assert_allclose(means[-1] - means[0], exact, rtol=0, atol=0.02 * np.linalg.norm(exact))


def test_what_the_tables_cannot_tell_is_said(phantom):
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    tables = fast_prediction_tables(tissue, 0.1)
    with pytest.raises(ValueError, match="predict_fast: expected a filter after its first frame"):
        predict_fast(tables, tissue)
    tissue.predict(0.0)
    with pytest.raises(ValueError, match=r"push: expected shape \(3, n_free, dim\)"):
        predict_fast(tables, tissue, np.zeros((2, 4, 2)))


def test_unknown_constants_are_considered(phantom, rest_state, driven, poke_forces, marks_of):
    """Ten stiffnesses to 10 %: sigma up to 1 s ahead is that of the filter within 10 % in nine of ten, 5 % on average.

    Without what they do from now on it is 12 to 34 % too small. The level of white noise is as stated: learnt, it would
    stand for some of the errors of constants.
    """
    unsure = independent_uncertainty(parameters(phantom, ("stiffness",)), 0.1)
    rng, off, small = np.random.default_rng(5), [], []
    states = driven(phantom, rest_state, poke_forces(phantom, 2.0, rng))
    tissue = TissueFilter(phantom, HIDDEN, OUTER, FilterSettings(white_bounds=(1.0, 1.0)), uncertainty=unsure)
    tables = fast_prediction_tables(tissue, 1.0)
    for k, state in enumerate(states[::4]):
        tissue.predict(k * FRAME_S)
        tissue.update(marks_of(phantom, state, 1e-3, rng))
        if k >= 20 and k % 10 == 0:
            times, _, covs = predict_fast(tables, tissue)
            now = moments_now(tables, tissue)
            _, less = moments_ahead(tables, replace(now, forced=np.zeros_like(now.forced)))
            exact = np.sqrt(np.trace(tissue.predict_path(times)[1], axis1=1, axis2=2))
            off.append(np.abs(np.sqrt(np.trace(covs, axis1=1, axis2=2)) / exact - 1.0))
            small.append(np.sqrt(np.trace(less, axis1=1, axis2=2)) / exact)
    assert len(off) == 5
    assert np.quantile(off, 0.9) < 0.1
    assert np.mean(off) < 0.05
    assert (np.array(small)[:, 5:] < 0.95).all()


def test_without_friction_there_is_one_speed_and_tables_are_made_as_they_are_needed(phantom):
    smooth = replace(phantom, friction=np.zeros(phantom.n_nodes))
    assert len(fast_prediction_tables(TissueFilter(smooth, HIDDEN, OUTER), 0.1).speeds) == 1
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    tissue.predict(0.0)
    later = fast_prediction_tables(tissue, 0.1, at_once=False)
    assert not later.made
    at_once = predict_fast(fast_prediction_tables(tissue, 0.1), tissue)
    for one, other in zip(predict_fast(later, tissue), at_once, strict=True):
        np.testing.assert_array_equal(one, other)
    assert len(later.made) == 1
