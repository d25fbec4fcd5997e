"""Bodies that the tests of this folder share."""

import numpy as np

from dynamics import MassSpringNetwork


def cable(n: int, *, held: bool = True) -> MassSpringNetwork:
    """A chain of free nodes of 10 g along a line in space, 50 mm apart, after an anchor if it is held."""
    m = n + held
    pairs = np.column_stack([np.arange(m - 1), np.arange(1, m)])
    return MassSpringNetwork(
        names=tuple(f"n{k}" for k in range(m)),
        positions=0.05 * np.arange(m)[:, None] * [1.0, 0.0, 0.0],
        masses=np.full(m, 0.01),
        fixed=np.arange(m) < held,
        drag=np.full(m, 0.01),
        friction=np.zeros(m),
        springs=pairs,
        stiffness=np.full(m - 1, 200.0),
        rest_lengths=np.full(m - 1, 0.05),
        damping=np.full(m - 1, 0.05),
        gravity=np.array([0.0, 0.0, -9.81]),
    )
