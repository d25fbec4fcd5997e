"""Constants by name, scaled on a log scale, and how uncertain they are; `test_laws.py` has their forces."""

import re

import numpy as np
import pytest

from dynamics import (
    NetworkError,
    Parameter,
    ParameterUncertainty,
    four_mass_phantom,
    independent_uncertainty,
    parameter_label,
    parameter_named,
    parameter_value,
    parameters,
    scale_parameters,
    strain_uncertainty,
)
from tests.networks import build_network

PHANTOM = four_mass_phantom()
ALL = parameters(PHANTOM)


def test_all_positive_constants_have_a_name_and_are_found_by_it():
    assert len(ALL) == 3 * 10 + 2 * 4
    names = [parameter_label(PHANTOM, one) for one in ALL]
    assert len(set(names)) == 38
    assert names[0] == "stiffness M1-M2"
    assert names[-1] == "friction M4"
    assert [parameter_named(PHANTOM, name) for name in names] == list(ALL)
    with pytest.raises(NetworkError, match='no positive constant named "drag In1"'):
        parameter_named(PHANTOM, "drag In1")
    assert parameters(PHANTOM, ("drag",)) == tuple(Parameter("drag", i) for i in range(4))


def test_scaling_is_on_a_log_scale_and_touches_nothing_else():
    """Value exp(change); the rest to the bit."""
    which = (parameter_named(PHANTOM, "rest_length M2-M3"), parameter_named(PHANTOM, "drag M2"))
    changed = scale_parameters(PHANTOM, which, [np.log(1.5), -np.log(2.0)])
    assert parameter_value(changed, which[0]) == pytest.approx(0.3, rel=1e-14)
    assert parameter_value(changed, which[1]) == pytest.approx(0.1, rel=1e-14)
    same = [one for one in ALL if one not in which]
    assert [parameter_value(changed, one) for one in same] == [parameter_value(PHANTOM, one) for one in same]


def test_uncertainty_is_checked_and_has_a_covariance():
    both = ParameterUncertainty(ALL[:2], np.array([[0.1, 0.2], [0.0, 0.3]]))
    np.testing.assert_allclose(both.cov, [[0.01, 0.02], [0.02, 0.13]], rtol=1e-14)
    np.testing.assert_allclose(independent_uncertainty(ALL[:3], 0.1).cov, 0.01 * np.eye(3), rtol=1e-14)
    with pytest.raises(NetworkError, match=r"directions: expected shape \(n_directions, 2\), found \(1, 3\)"):
        ParameterUncertainty(ALL[:2], np.ones((1, 3)))
    with pytest.raises(NetworkError, match="expected finite numbers"):
        ParameterUncertainty(ALL[:2], np.array([[0.1, np.nan]]))


@pytest.mark.parametrize("sd", [710.0, 5e17, 1e200])
def test_an_uncertainty_by_a_factor_that_is_no_number_is_refused(sd):
    """exp(709.78) is the largest floating-point number; 1e200 squared is none."""
    which = (Parameter("stiffness", 0), Parameter("damping", 2))
    named = re.escape(f"expected the log of damping 2 known to 709.8 or less, a finite factor, found {sd:.3g}")
    with pytest.raises(NetworkError, match=named):
        ParameterUncertainty(which, np.array([[0.1, 0.6 * sd], [0.0, 0.8 * sd]]))
    assert ParameterUncertainty(which, np.array([[0.1, 700.0]])).cov[1, 1] == pytest.approx(4.9e5)


def test_two_uncertainties_beside_each_other_add_their_covariances():
    """Constants in both have the sum of both, those in one their own; constants of different ones are independent."""
    one = ParameterUncertainty(
        (Parameter("stiffness", 0), Parameter("rest_length", 1)), np.array([[0.3, 0.1], [0.0, -0.2]])
    )
    other = ParameterUncertainty((Parameter("rest_length", 1), Parameter("rest_length", 0)), np.array([[0.05, -0.04]]))
    both = one.beside(other)
    assert both.parameters == (Parameter("stiffness", 0), Parameter("rest_length", 1), Parameter("rest_length", 0))
    expected = np.zeros((3, 3))
    expected[:2, :2] += one.cov
    expected[1:, 1:] += other.cov
    np.testing.assert_allclose(both.cov, expected, rtol=1e-14)
    assert len(both.directions) == 3


def star(middles, along):
    """Springs of 20 mm through these middles in these directions, in space, all of one stiffness."""
    ends = [middle + sign * 0.01 * n for middle, n in zip(middles, along, strict=True) for sign in (-1.0, 1.0)]
    return build_network(ends, np.arange(2 * len(along)).reshape(-1, 2))


def directions_at_random(n, rng):
    along = rng.normal(size=(n, 3))
    return along / np.linalg.norm(along, axis=1)[:, None]


def test_springs_at_one_place_change_with_one_strain_tensor():
    """Against 100,000 symmetric tensors drawn entry by entry: sd on the diagonal, sd by the root of two beside it."""
    rng = np.random.default_rng(0)
    along = directions_at_random(7, rng)
    found = strain_uncertainty(star(np.zeros((7, 3)), along), 0.02).cov
    drawn = 0.02 * rng.normal(size=(100_000, 3, 3))
    drawn = 0.5 * (drawn + drawn.swapaxes(1, 2))
    shares = np.einsum("ni,tij,nj->tn", along, drawn, along)
    np.testing.assert_allclose(found, np.cov(shares.T), rtol=0, atol=0.02 * 0.02**2)
    assert np.linalg.matrix_rank(found, tol=1e-9) == 6  # a tensor has six entries


def test_strain_of_springs_that_are_far_apart_is_another():
    """Parallel springs along a line of 0.1 m: by exp(-d² / 2 l²), l half the line."""
    places = np.linspace(0.0, 0.1, 5)
    network = star(np.outer(places, [1.0, 0.0, 0.0]), np.tile([0.0, 1.0, 0.0], (5, 1)))
    apart = (places[:, None] - places) / 0.05
    np.testing.assert_allclose(
        strain_uncertainty(network, 0.01, length=0.5).cov, 1e-4 * np.exp(-0.5 * apart**2), rtol=1e-9
    )


def test_few_directions_hold_most_of_a_smooth_strain():
    """Of 300 springs all over a body 24 directions leave less than a third of the variance, none below zero."""
    rng = np.random.default_rng(1)
    network = star(rng.uniform(-0.05, 0.05, (300, 3)), directions_at_random(300, rng))
    left = [1.0 - np.diag(strain_uncertainty(network, 1.0, n_directions=n).cov) for n in (1, 6, 24)]
    assert all(each.min() > -1e-9 for each in left)
    means = [each.mean() for each in left]
    assert means[0] > means[1] > means[2]
    assert means[2] < 1.0 / 3.0
