"""Bodies that the tests of this folder share."""

import numpy as np

from dynamics import MassSpringNetwork
from dynamics import build_network as named_network
from tests.networks import build_network


def cable(n: int, *, held: bool = True) -> MassSpringNetwork:
    """A chain of free nodes of 10 g along a line in space, 50 mm apart, after an anchor if it is held."""
    m = n + held
    positions = 0.05 * np.arange(m)[:, None] * [1.0, 0.0, 0.0]
    constants = {"masses": 0.01, "drag": 0.01, "stiffness": 200.0, "damping": 0.05, "gravity": [0.0, 0.0, -9.81]}
    springs, names = [(k, k + 1) for k in range(m - 1)], [f"n{k}" for k in range(m)]
    return build_network(positions, springs, range(held), names, **constants)


def two_masses(stiffness: float, gravity_m_s2: float = 0.0) -> MassSpringNetwork:
    """Masses x and y of 50 g on anchors a to d in space, springs of one stiffness [N/m]; gravity along -z."""
    places = 1e-3 * np.array([[0, 0, 0], [80, 0, 0], [40, 70, 0], [40, 30, -60], [40, 30, 30], [45, 25, -25]])
    return named_network(
        list("abcdxy"),
        places,
        [(a, b) for a in "abcd" for b in "xy"] + [("x", "y")],
        masses=0.05,
        stiffness=stiffness,
        damping=0.2 * np.sqrt(stiffness),
        fixed=list("abcd"),
        gravity=[0.0, 0.0, -gravity_m_s2],
    )
