"""Constants by name, scaled on a log scale, and the forces that a change of each makes: against differences."""

import numpy as np
import pytest

from dynamics import (
    KINDS,
    NetworkError,
    Parameter,
    ParameterForces,
    ParameterUncertainty,
    four_mass_phantom,
    independent_uncertainty,
    node_forces,
    pack,
    parameter_forces,
    parameter_label,
    parameter_named,
    parameter_value,
    parameters,
    scale_parameters,
)

PHANTOM = four_mass_phantom()
ALL = parameters(PHANTOM)


@pytest.fixture(scope="module")
def moving():
    """Positions and velocities of all nodes, anchors at rest."""
    rng = np.random.default_rng(0)
    x = PHANTOM.positions + np.where(PHANTOM.fixed[:, None], 0.0, rng.normal(0.0, 0.02, (7, 2)))
    return x, np.where(PHANTOM.fixed[:, None], 0.0, rng.normal(0.0, 0.3, (7, 2)))


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


@pytest.mark.parametrize("kind", KINDS)
def test_forces_of_a_change_are_differences_of_the_forces(moving, kind):
    """Central differences of `node_forces` in the log of each constant, 1e-5: 1e-8 N of forces of some newtons."""
    which = parameters(PHANTOM, (kind,))
    found = parameter_forces(PHANTOM, which, *moving)
    for k, one in enumerate(which):
        ends = [
            node_forces(scale_parameters(PHANTOM, [one], [s * 1e-5]), *moving)[PHANTOM.free].ravel()
            for s in (1.0, -1.0)
        ]
        np.testing.assert_allclose(found[k], (ends[0] - ends[1]) / 2e-5, rtol=0, atol=1e-8)
        assert np.abs(found[k]).max() > 1e-4


def test_the_compiled_form_is_the_plain_one(moving):
    x, v = moving
    compiled = ParameterForces(PHANTOM, ALL)(pack(x[PHANTOM.free], v[PHANTOM.free]))
    np.testing.assert_allclose(compiled, parameter_forces(PHANTOM, ALL, x, v), rtol=0, atol=1e-13)


def test_uncertainty_is_checked_and_has_a_covariance():
    both = ParameterUncertainty(ALL[:2], np.array([[0.1, 0.2], [0.0, 0.3]]))
    np.testing.assert_allclose(both.cov, [[0.01, 0.02], [0.02, 0.13]], rtol=1e-14)
    np.testing.assert_allclose(independent_uncertainty(ALL[:3], 0.1).cov, 0.01 * np.eye(3), rtol=1e-14)
    with pytest.raises(NetworkError, match=r"directions: expected shape \(n_directions, 2\), found \(1, 3\)"):
        ParameterUncertainty(ALL[:2], np.ones((1, 3)))
    with pytest.raises(NetworkError, match="expected finite numbers"):
        ParameterUncertainty(ALL[:2], np.array([[0.1, np.nan]]))
