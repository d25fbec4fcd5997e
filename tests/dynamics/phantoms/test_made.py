"""Phantoms of as many masses as asked for: at rest where drawn, sturdy, the target inside of what is seen."""

import numpy as np
import pytest

from dynamics import NetworkError, breast_phantom, oscillations, planar_phantom, rest_shape

PLANAR, BREAST = range(4, 61), (6, 8, 10, 14, 20, 35, 60)


@pytest.mark.parametrize("n_masses", PLANAR)
def test_a_planar_phantom_stands_on_the_floor(n_masses: int) -> None:
    """At rest as drawn, with frequencies of a phantom that a rod does not turn over: 1 to 4 Hz the lowest."""
    phantom = planar_phantom(n_masses)
    network = phantom.network
    assert len(network.free) == n_masses
    np.testing.assert_allclose(rest_shape(network), network.positions, atol=1e-9)
    assert 1.0 < oscillations(network, network.positions).frequencies_hz[0] < 4.0
    check_target(phantom)


@pytest.mark.parametrize("n_masses", BREAST)
def test_a_breast_phantom_hangs_on_its_wall(n_masses: int) -> None:
    """At rest as drawn; shear waves of 1 to 1.3 m/s cross its 60 mm in a quarter of a period: about 4 to 5 Hz."""
    phantom = breast_phantom(n_masses)
    network = phantom.network
    assert len(network.free) == n_masses
    np.testing.assert_allclose(rest_shape(network), network.positions, atol=1e-9)
    assert 3.0 < oscillations(network, network.positions).frequencies_hz[0] < 6.0
    on_skin = np.linalg.norm(network.positions[[network.index(name) for name in phantom.outer]], axis=1)
    np.testing.assert_allclose(on_skin, 0.060)
    check_target(phantom)


def check_target(phantom) -> None:
    """Free, not seen, and nearer to the middle of the free nodes than those seen are on average."""
    network = phantom.network
    assert not network.fixed[network.index(phantom.target)]
    assert phantom.target not in phantom.outer
    assert len(phantom.groups) == len(network.springs)
    middle = network.positions[network.free].mean(axis=0)
    away = {name: np.linalg.norm(network.positions[network.index(name)] - middle) for name in network.names}
    assert away[phantom.target] < np.mean([away[name] for name in phantom.outer])


def test_the_five_are_a_quincunx() -> None:
    phantom = planar_phantom(5)
    assert phantom.target == "M3"
    assert phantom.outer == ("M1", "M2", "M4", "M5")
    places = 1e3 * phantom.network.positions[:5]
    np.testing.assert_allclose(places, [[-60, 60], [60, 60], [0, 120], [-60, 180], [60, 180]], atol=1e-9)


def test_stiffness_follows_the_modulus() -> None:
    soft, stiff = breast_phantom(10, 4e3).network, breast_phantom(10, 8e3).network
    np.testing.assert_allclose(stiff.stiffness, 2.0 * soft.stiffness)


@pytest.mark.parametrize("made", [planar_phantom, breast_phantom])
@pytest.mark.parametrize("n_masses", [3, 61])
def test_other_numbers_are_refused(made, n_masses: int) -> None:
    with pytest.raises(NetworkError, match=rf"masses: expected \d to 60 of a \w+ phantom, found {n_masses}"):
        made(n_masses)
