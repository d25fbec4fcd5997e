"""The unbraced phantom by MuJoCo against the rest shape by our own forces."""

import numpy as np

from experiments.simulation.bodies.body import Scale
from experiments.simulation.bodies.phantom import unbraced_phantom


def test_it_hangs_where_our_own_equilibrium_says():
    """Within what friction of 0.02 N holds back against the softest motion of 8 N/m."""
    body = unbraced_phantom(0, Scale(), seconds=0.2)
    away = np.linalg.norm(body.positions[0] - body.network.positions, axis=1)
    assert away.max() < 0.02 / 8.0
    hanging = body.network.positions[body.network.free, 1]
    assert (hanging < 0.0).all()
