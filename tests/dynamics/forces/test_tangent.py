"""The linearised motion is the slope of the motion, and the stable step is stable."""

import numpy as np
import pytest

from dynamics import derivative, kinetic_energy, pack, potential_energy, rest_shape, stable_step, state_matrix
from dynamics.forces.kernels import packed, runge_kutta
from dynamics.forces.tangent import RK4_RADIUS


def growth(z):
    """R(z) of classical Runge-Kutta, by which a step of h multiplies exp(lambda t), z = h lambda."""
    return 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24


def stepped(network, state, h, n_steps):
    """The state after n_steps of exactly h, whatever limit a `Stepper` would keep."""
    inverse_mass = np.zeros(network.n_nodes)
    inverse_mass[network.free] = 1.0 / network.masses[network.free]
    none = np.zeros((1, len(state) // 2))
    args = (network.positions, network.free, inverse_mass, packed(network))
    return runge_kutta(np.ascontiguousarray(state)[None], none, h, n_steps, *args)[0]


@pytest.mark.parametrize("dim", [2, 3])
def test_state_matrix_is_the_slope_of_the_motion(tangled, slope, dim):
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


@pytest.fixture
def chain(build):
    """Eight masses in a row between two anchors, ten springs of 80 N/m at ease, no losses."""
    return build([[0.1 * i, 0.0] for i in range(10)], [(i, i + 1) for i in range(9)], [0, 9])


def test_stable_step_of_a_chain(chain):
    """Highest frequency of a chain of n held at both ends: 2 sqrt(k/m) sin(n pi / (2 (n + 1))). Rounding."""
    highest = 2.0 * np.sqrt(80.0 / 0.2) * np.sin(8 * np.pi / 18)
    assert stable_step(chain) == pytest.approx(2.6 / highest, rel=1e-13)


def energy_of(network, state):
    x, v = network.positions.copy(), np.zeros_like(network.positions)
    x[network.free], v[network.free] = (half.reshape(-1, network.dim) for half in np.split(state, 2))
    return potential_energy(network, x) + kinetic_energy(network, v)


def test_a_chain_is_stable_just_inside_and_explodes_outside_the_exact_limit(chain):
    """Along itself the chain is linear: its highest mode is multiplied by |R(i w h)| a step, 1 at w h = 2 sqrt(2)."""
    highest = 2.0 * np.sqrt(400.0) * np.sin(8 * np.pi / 18)
    along = np.zeros((8, 2))
    along[:, 0] = 1e-3 * np.sin(8 * np.pi / 9 * np.arange(1, 9))
    state = pack(chain.positions[chain.free] + along, np.zeros((8, 2)))
    start = energy_of(chain, state)
    inside = 0.98 * stable_step(chain)
    assert energy_of(chain, stepped(chain, state, inside, 30)) == pytest.approx(
        start * abs(growth(1j * highest * inside)) ** 60, rel=1e-6
    )  # rounding of positions near 1 m against 1 mm, squared
    outside = 2.0 * np.sqrt(2.0) / highest * 1.02
    factor = abs(growth(1j * highest * outside)) ** 20
    assert factor > 3.0
    assert energy_of(chain, stepped(chain, state, outside, 10)) == pytest.approx(start * factor, rel=1e-6)


def test_the_phantom_is_stable_inside_the_step_and_explodes_outside_its_true_limit(phantom):
    """True limit at rest: the largest h with |R(h lambda)| <= 1 for all eigenvalues lambda of `state_matrix`."""
    rest = rest_shape(phantom)
    at_rest = pack(rest[phantom.free], np.zeros((4, 2)))
    eigenvalues = np.linalg.eigvals(state_matrix(phantom, rest))
    steps = np.linspace(0.02, 0.06, 4001)
    limit = steps[np.argmax(np.abs(growth(steps[:, None] * eigenvalues)).max(axis=1) > 1.0)]
    inside = 0.98 * stable_step(phantom)
    assert inside < limit
    rng = np.random.default_rng(8)
    for _ in range(5):
        shaken = at_rest + np.r_[0.02 * rng.normal(size=8), 0.5 * rng.normal(size=8)]
        # Slowest mode: Re lambda = -10.7/s, so 10 s leave exp(-100) of it: nothing but rounding.
        np.testing.assert_allclose(stepped(phantom, shaken, inside, round(10.0 / inside)), at_rest, rtol=0, atol=1e-12)
    nudged = at_rest + 1e-9 * rng.normal(size=16)
    assert np.abs(stepped(phantom, nudged, 1.05 * limit, 200) - at_rest).max() > 1e-5
