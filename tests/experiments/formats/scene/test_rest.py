"""Of bodies that cannot rest near where they are drawn the key in another unit is named; those that sag are taken."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dynamics import MassSpringNetwork, build_network, four_mass_phantom, spring_lengths
from dynamics.phantoms.breast import breast_phantom
from experiments.formats.scene.rest import check_rest
from experiments.formats.scene.schema import SceneError

PHANTOMS = {"four-mass": four_mass_phantom(), "breast": breast_phantom(10).network}


def as_drawn(network: MassSpringNetwork) -> MassSpringNetwork:
    """With rest lengths that are the distances drawn, as of a body whose rest was not found yet."""
    return replace(network, rest_lengths=spring_lengths(network.positions, network.springs))


def shrunk(network: MassSpringNetwork) -> MassSpringNetwork:
    return replace(network, positions=1e-3 * network.positions, rest_lengths=1e-3 * network.rest_lengths)


def heavy(network: MassSpringNetwork) -> MassSpringNetwork:
    return replace(as_drawn(network), masses=1e5 * network.masses)


SOFT = r": .* 1000 times too soft; in {}\?"
SLIPS: dict[str, tuple[Callable[[MassSpringNetwork], MassSpringNetwork], str]] = {
    "g": (lambda n: replace(n, masses=1e3 * n.masses), r"node\[0\]\.mass_kg"),
    "N/mm": (lambda n: replace(n, stiffness=1e-3 * n.stiffness), r"spring\[0\]\.stiffness_N_m"),
    "mm/s²": (lambda n: replace(n, gravity=1e3 * n.gravity), "gravity_m_s2"),
    "m": (shrunk, r"node\[0\]\.position_mm"),
}


@pytest.mark.parametrize("rest_lengths", ["at rest", "as drawn"])
@pytest.mark.parametrize("slip", SLIPS)
@pytest.mark.parametrize("phantom", PHANTOMS)
def test_the_key_in_another_unit_is_named(phantom: str, slip: str, rest_lengths: str) -> None:
    network, (wrong, key) = PHANTOMS[phantom], SLIPS[slip]
    with pytest.raises(SceneError, match=key + SOFT.format(slip)):
        check_rest(wrong(network if rest_lengths == "at rest" else as_drawn(network)))


STIFF, LENGTH = r"stiffness_N_m: .* ", r"spring\[0\]\.rest_length_mm: .* "


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda n: replace(n, stiffness=1e4 * n.stiffness), f"{STIFF}found 2500000.0, .* 10000 times too stiff"),
        (lambda n: replace(n, stiffness=1e3 * n.stiffness), rf"{STIFF}1000 times too stiff; in mN/m\?"),
        (lambda n: replace(n, masses=1e-3 * n.masses), r"mass_kg: expected .* found 0.0002, .* too stiff; in t\?"),
        (lambda n: replace(n, rest_lengths=1e-3 * n.rest_lengths), f"{LENGTH}204.1 mm, found 0.2;"),
        (lambda n: replace(n, positions=1e-3 * n.positions), f"{LENGTH}0.2041 mm, found 200;"),
        (lambda n: replace(n, stiffness=1e100 * n.stiffness), r"spring\[0\]\.stiffness_N_m: expected springs that bal"),
        (lambda n: replace(n, masses=1e300 * n.masses), r"node\[0\]\.mass_kg: expected springs that balance"),
        (heavy, r"^network: expected a rest shape within one body size .* found \"M"),
    ],
)
def test_other_slips(wrong: Callable[[MassSpringNetwork], MassSpringNetwork], said: str) -> None:
    with pytest.raises(SceneError, match=said):
        check_rest(wrong(PHANTOMS["four-mass"]))


def cable(drawn: np.ndarray) -> MassSpringNetwork:
    """Five masses of 20 g on a string of 0.5 m, held at its first end."""
    names, links = ["In", *(f"M{k}" for k in range(1, 6))], [(i, i + 1) for i in range(5)]
    held = {"fixed": ["In"], "gravity": [0.0, -9.81], "rest_lengths": "as drawn"}
    return build_network(names, drawn, links, masses=0.02, stiffness=2000.0, **held)


@pytest.mark.parametrize("factor", [0.1, 10.0])
@pytest.mark.parametrize("rest_lengths", ["at rest", "as drawn"])
@pytest.mark.parametrize("phantom", PHANTOMS)
def test_a_stiffness_that_is_only_wrong_is_taken(phantom: str, factor: float, rest_lengths: str) -> None:
    """Identification is there for it."""
    network = PHANTOMS[phantom] if rest_lengths == "at rest" else as_drawn(PHANTOMS[phantom])
    check_rest(replace(network, stiffness=factor * network.stiffness))


def test_bodies_that_turn_or_hang_are_taken() -> None:
    """A cable drawn level hangs by more than its own length away; without an anchor it hangs on its marks."""
    level = np.stack([0.1 * np.arange(6.0), np.zeros(6)], axis=1)
    level[:, 1] = 1e-3 * np.arange(6.0) ** 2  # drawn inexactly: not on a line
    hanging = cable(level)
    check_rest(hanging)
    check_rest(replace(PHANTOMS["four-mass"], gravity=np.zeros(2)))
    loose = replace(as_drawn(PHANTOMS["four-mass"]), fixed=np.zeros(7, dtype=bool))
    check_rest(replace(loose, masses=1e3 * np.maximum(loose.masses, 0.1)))
