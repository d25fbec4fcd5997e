"""Every force law against finite differences, in everything that is assembled from it.

A new constant in `LAWS` needs a range in VALUES, and all tests below hold it to its own derivatives.
"""

import numpy as np
import pytest

from dynamics import (
    KINDS,
    LAWS,
    ParameterForces,
    Stepper,
    damping_matrix,
    node_forces,
    pack,
    parameter_forces,
    parameters,
    plain_step,
    potential_energy,
    rest_shape,
    scale_parameters,
    stable_step,
    state_matrix,
    stiffness_matrix,
)
from dynamics.forces import kernels
from dynamics.forces.kernels import FIELDS, OF_SPRINGS, NodeConstants, SpringConstants, node_resistance
from dynamics.forces.tangent import RK4_RADIUS
from tests.dynamics.conftest import moved, random_network, slope

VALUES = {
    "stiffness": (50.0, 150.0),
    "rest_length": (0.2, 0.5),
    "damping": (0.1, 0.6),
    "drag": (0.1, 0.4),
    "friction": (0.01, 0.03),
}
"""Range of each kind of constant, SI."""

NEEDED = ("stiffness", "rest_length")
"""A spring has these whatever other laws it follows."""

EACH = [*LAWS, "all"]


def kinds_of(law):
    """The kinds of constants that are not 0 where this law is looked at."""
    return KINDS if law == "all" else (*NEEDED, *LAWS[law])


def following(law, dim):
    """A network of five nodes in which only this law, or all, have constants that are not 0."""
    rng = np.random.default_rng(17 + dim)
    network = random_network(dim)
    fields = {}
    for kind in KINDS:
        values = rng.uniform(*VALUES[kind], len(getattr(network, FIELDS[kind])))
        fields[FIELDS[kind]] = values if kind in kinds_of(law) else 0.0 * values
    return random_network(dim, **fields)


def moving(network, shape):
    """Positions and velocities of all nodes: moved at random, two nodes in each other's places, or 1 cm apart."""
    (x, v), free = moved(network), network.free
    if shape != "moved":
        x = network.positions.copy()
    if shape == "reversed":
        x[free[:2]] = x[free[:2]][::-1] + 0.02
    elif shape == "collapsed":
        x[free[0]] = x[free[1]] + 0.01 / np.sqrt(network.dim)
    return x, v


def placed(network, everywhere, free):
    """Of all nodes, with these of the free ones."""
    found = everywhere.copy()
    found[network.free] = free
    return found


def slope_of(function, at, h):
    """Derivative of a function of one number, five-point rule, error h⁴ f⁽⁵⁾ / 30."""
    f = [function(at + a * h) for a in (-2, -1, 1, 2)]
    return (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * h)


def test_every_kind_of_constant_belongs_to_one_law_and_to_a_field_of_its_element():
    assert SpringConstants._fields + NodeConstants._fields == KINDS
    assert len(set(KINDS)) == len(KINDS)
    assert set(VALUES) == set(KINDS)
    for kinds in LAWS.values():
        assert len({kind in OF_SPRINGS for kind in kinds}) == 1


@pytest.mark.parametrize("law", EACH)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("shape", ["moved", "reversed", "collapsed"])
class TestAssembled:
    """What is assembled from the laws, in plane and space, also with springs reversed and nearly of no length."""

    def test_force_at_rest_is_minus_the_gradient_of_the_energy(self, law, dim, shape):
        """F = -dV/dx; at 1 cm h⁴ k l0 24 / l⁴ / 30 is 1e-9 N of 50 N at a step of 1e-5 m, and so is rounding."""
        network = following(law, dim)
        x, _ = moving(network, shape)

        def energy(free):
            return potential_energy(network, placed(network, x, free))

        force = node_forces(network, x, np.zeros_like(x))[network.free]
        assert np.abs(force).max() > 1.0
        np.testing.assert_allclose(force.ravel(), -slope(energy, x[network.free], 1e-5), rtol=0, atol=1e-8)

    def test_stiffness_matrix_is_the_slope_of_the_force(self, law, dim, shape):
        """K = -dF/dx at rest: 1e-7 N/m of thousands, error as above over 1e-5 m times 1/l."""
        network = following(law, dim)
        x, _ = moving(network, shape)

        def force(free):
            return node_forces(network, placed(network, x, free), np.zeros_like(x))[network.free].ravel()

        K = stiffness_matrix(network, x)
        np.testing.assert_allclose(K, -slope(force, x[network.free], 1e-5), rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(K, K.T, rtol=0, atol=1e-12 * np.abs(K).max())

    def test_damping_matrix_is_the_slope_of_the_force_at_rest(self, law, dim, shape):
        """C = -dF/dv at v = 0. Friction bends over 5 mm/s: five-point error (h / 5e-3)⁴ 6 N s/m = 1e-10 at 1e-5 m/s."""
        network = following(law, dim)
        x, _ = moving(network, shape)

        def force(free):
            return node_forces(network, x, placed(network, np.zeros_like(x), free))[network.free].ravel()

        found = damping_matrix(network, x)
        np.testing.assert_allclose(found, -slope(force, np.zeros((len(network.free), dim)), 1e-5), rtol=0, atol=2e-8)

    def test_resistance_at_a_speed_is_force_over_speed(self, law, dim, shape):
        """C v is the loss force where all nodes move together at that speed: springs keep their lengths. Rounding."""
        network = following(law, dim)
        x, _ = moving(network, shape)
        v = np.zeros_like(x)
        v[:, 0] = 0.2
        lost = node_forces(network, x, v) - node_forces(network, x, np.zeros_like(x))
        C = damping_matrix(network, x, speed_m_s=0.2) - _dashpots(network, x)
        np.testing.assert_allclose(-C @ v[network.free].ravel(), lost[network.free].ravel(), rtol=0, atol=1e-12)

    def test_parameter_forces_are_slopes_of_the_force_in_the_log_of_each_constant(self, law, dim, shape):
        """Five-point rule at 1e-3: some 1e-11 of the force, and rounding; the compiled form to rounding."""
        network = following(law, dim)
        x, v = moving(network, shape)
        which = parameters(network)
        assert {one.kind for one in which} == set(kinds_of(law))
        found = parameter_forces(network, which, x, v)
        for k, one in enumerate(which):
            changed = slope_of(
                lambda log, one=one: node_forces(scale_parameters(network, [one], [log]), x, v)[network.free].ravel(),
                0.0,
                1e-3,
            )
            np.testing.assert_allclose(found[k], changed, rtol=1e-10, atol=1e-9)
        for kind in kinds_of(law):
            assert max(np.abs(found[k]).max() for k, one in enumerate(which) if one.kind == kind) > 1e-3
        compiled = ParameterForces(network, which)(pack(x[network.free], v[network.free]))
        np.testing.assert_allclose(compiled, found, rtol=0, atol=1e-12)


def _dashpots(network, x):
    """Part of the damping matrix that is of springs."""
    return damping_matrix(network, x) - np.diag(
        np.repeat(node_resistance(0.0, kernels.node_constants(network))[network.free], network.dim)
    )


@pytest.mark.parametrize("law", EACH)
@pytest.mark.parametrize("dim", [2, 3])
def test_the_stability_limit_bounds_every_eigenvalue(law, dim):
    """|lambda| <= 2.6 / stable_step in shapes whose springs are 0.5 to 1.5 times their rest lengths, and not twice."""
    network, rng, closest = following(law, dim), np.random.default_rng(9), 0.0
    which = parameters(network, ("rest_length",))
    for _ in range(8):
        x = network.positions.copy()
        x[network.free] += 0.1 * rng.normal(size=x[network.free].shape)
        lengths = np.linalg.norm(x[network.springs[:, 1]] - x[network.springs[:, 0]], axis=1)
        rest_lengths = lengths / rng.uniform(0.5, 1.5, len(lengths))
        stretched = scale_parameters(network, which, np.log(rest_lengths / network.rest_lengths))
        largest = np.abs(np.linalg.eigvals(state_matrix(stretched, x))).max()
        closest = max(closest, largest * stable_step(stretched) / RK4_RADIUS)
    assert 0.5 < closest <= 1.0


@pytest.mark.parametrize("law", EACH)
@pytest.mark.parametrize("dim", [2, 3])
def test_energy_without_losses_is_kept_and_losses_only_take(law, dim):
    """1 s in steps of a hundredth of the stable one: drift of order h⁴, 1e-6 of the energy; losses never add."""
    network = following(law, dim)
    rest = rest_shape(network)
    v = 0.2 * np.random.default_rng(4).normal(size=rest[network.free].shape)
    state = pack(rest[network.free], v)[None]
    stepper = Stepper(network, 0.02 * stable_step(network))
    energies = []
    for _ in range(10):
        x, speeds = rest.copy(), np.zeros_like(rest)
        half = network.n_state // 2
        x[network.free], speeds[network.free] = state[0, :half].reshape(-1, dim), state[0, half:].reshape(-1, dim)
        energies.append(
            potential_energy(network, x)
            - potential_energy(network, rest)
            + 0.5 * network.masses[network.free] @ (speeds[network.free] ** 2).sum(axis=1)
        )
        state = stepper.advance(state, 0.1)
    change = np.diff(energies) / energies[0]
    if not any(getattr(network, FIELDS[kind]).any() for kind in ("damping", *NodeConstants._fields)):
        assert np.abs(change).max() < 1e-6
    else:
        assert change.max() < 1e-9
        assert energies[-1] < 0.95 * energies[0]


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_the_slip_velocity_is_numerical(phantom, monkeypatch, factor):
    """Half and twice the slip velocity change the motion after an impulse of 0.5 m/s, but by less than 1 %."""
    rest = pack(phantom.positions[phantom.free], np.zeros((4, 2)))
    state = rest.copy()
    state[8:] += 0.5 * np.random.default_rng(10).normal(size=8)
    ends, slip = [], kernels.SLIP_VELOCITY
    for each in (1.0, factor):
        monkeypatch.setattr(kernels, "SLIP_VELOCITY", each * slip)
        path = [state]
        for _ in range(12):
            path.append(plain_step(phantom, path[-1], 1.0 / 24.0, 10))
        ends.append(np.array(path)[:, :8] - rest[:8])
    moved = np.sqrt(np.mean((ends[1] - ends[0]) ** 2)) / np.sqrt(np.mean(ends[0] ** 2))
    assert 1e-6 < moved < 0.01
