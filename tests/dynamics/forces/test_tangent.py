"""The linearised motion is the slope of the motion, and the stable step is stable."""

import numpy as np
import pytest

from dynamics import derivative, pack, rest_shape, stable_step, state_matrix
from dynamics.forces.tangent import RK4_RADIUS
from tests.dynamics.conftest import slope


def growth(z):
    """R(z) of classical Runge-Kutta, by which a step of h multiplies exp(lambda t), z = h lambda."""
    return 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24


@pytest.mark.parametrize("dim", [2, 3])
def test_state_matrix_is_the_slope_of_the_motion(tangled, dim):
    """A = d(derivative)/d(state) about rest. Both steps of 1e-5: rounding of 20 N / 0.1 kg by 1e-5 m is 4e-9 1/s²."""
    network = tangled(dim)
    rest = rest_shape(network)[network.free]
    numeric = slope(lambda s: derivative(network, s), pack(rest, np.zeros_like(rest)), 1e-5)
    np.testing.assert_allclose(state_matrix(network, rest_shape(network)), numeric, rtol=0, atol=1e-7)


def test_runge_kutta_is_stable_in_the_half_disc_and_not_in_a_larger_one():
    """|R(z)| <= 1 for Re z <= 0, |z| <= 2.6; numerically the largest such disc has radius 2.6156 (arg z 122.5 deg)."""
    radii, angles = np.linspace(0.0, 2.7, 541), np.linspace(np.pi / 2, 3 * np.pi / 2, 2001)
    size = np.abs(growth(radii[:, None] * np.exp(1j * angles)))
    assert RK4_RADIUS == 2.6
    # On the imaginary axis |R|² = 1 - y⁶/72 + y⁸/576 <= 1, so what is over 1 near z = 0 is rounding.
    assert size[radii <= RK4_RADIUS].max() <= 1.0 + 1e-12
    assert size[radii >= 2.62].max(axis=1).min() > 1.0


@pytest.mark.parametrize(("c", "drag", "friction"), [(0.0, 0.0, 0.0), (0.5, 0.3, 0.02)])
def test_stable_step_of_one_mass(build, c, drag, friction):
    """2.6 over (d + sqrt(d² + 4 w²)) / 2 with w² = k/m = 400/s² and d = (c + drag + friction / 5e-3) / m. Rounding."""
    one = build([[0.0, 0.0], [0.2, 0.0]], [(0, 1)], [0], damping=c, drag=drag, friction=friction)
    d = (c + drag + friction / 5e-3) / 0.2
    assert stable_step(one) == pytest.approx(5.2 / (d + np.sqrt(d * d + 1600.0)), rel=1e-13)
