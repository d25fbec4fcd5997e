"""Phantoms of as many masses as asked for: at rest where drawn, sturdy, the target inside of what is seen."""

import numpy as np
import pytest

from dynamics import NetworkError, breast_phantom, oscillations, planar_phantom, rest_shape

PLANAR, BREAST = (4, 5, 6, 7, 12, 19, 20, 60), (6, 8, 14, 60)


@pytest.mark.parametrize(
    ("made", "n_masses", "low_hz", "high_hz"),
    [*((planar_phantom, n, 1.0, 4.0) for n in PLANAR), *((breast_phantom, n, 3.0, 6.0) for n in BREAST)],
)
def test_a_phantom_rests_as_drawn_with_its_target_inside(made, n_masses, low_hz, high_hz) -> None:
    """With frequencies of a phantom that a rod does not turn over; of a breast shear waves of 1 to 1.3 m/s.

    They cross its 60 mm in a quarter of a period: about 4 to 5 Hz. The target is free, not seen, and nearer to the
    middle of the free nodes than those seen are on average.
    """
    phantom = made(n_masses)
    network = phantom.network
    assert len(network.free) == n_masses
    assert len(phantom.groups) == len(network.springs)
    np.testing.assert_allclose(rest_shape(network), network.positions, atol=1e-9)
    assert low_hz < oscillations(network, network.positions).frequencies_hz[0] < high_hz
    place = {name: network.positions[network.index(name)] for name in network.names}
    if made is breast_phantom:
        np.testing.assert_allclose(np.linalg.norm([place[name] for name in phantom.outer], axis=1), 0.060)
    assert not network.fixed[network.index(phantom.target)]
    assert phantom.target not in phantom.outer
    middle = network.positions[network.free].mean(axis=0)
    away = {name: np.linalg.norm(at - middle) for name, at in place.items()}
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
