"""Bodies that the tests of this folder share."""

import numpy as np

from dynamics import MassSpringNetwork
from tests.networks import build_network


def cable(n: int, *, held: bool = True) -> MassSpringNetwork:
    """A chain of free nodes of 10 g along a line in space, 50 mm apart, after an anchor if it is held."""
    m = n + held
    positions = 0.05 * np.arange(m)[:, None] * [1.0, 0.0, 0.0]
    constants = {"masses": 0.01, "drag": 0.01, "stiffness": 200.0, "damping": 0.05, "gravity": [0.0, 0.0, -9.81]}
    springs, names = [(k, k + 1) for k in range(m - 1)], [f"n{k}" for k in range(m)]
    return build_network(positions, springs, range(held), names, **constants)
