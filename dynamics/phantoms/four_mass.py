"""The paper's phantom: four masses between two acrylic planes, standing on three points of the floor.

[paper] gives the topology (Fig. 3, Fig. 5), but no values of the constants. The constants below define this phantom;
they are not settings. The grid spacing is 200 mm, and each mass is 0.2 kg. The springs are so stiff that the phantom
stays upright under pokes of 10 m/s². Friction represents the "slightly friction" of the acrylic planes in [paper]. The
reasons are in `docs/decisions/02-phantom-constants.md`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynamics.equilibrium.rest import rest_shape
from dynamics.network.mass_spring import MassSpringNetwork, spring_lengths

SPACING_M = 0.200
MASS_KG = 0.200
STIFFNESS_N_M = 250.0
DAMPING_N_S_M = 0.6
DRAG_N_S_M = 0.2
FRICTION_N = 0.02

_PLACES = {
    "M1": (-1, 1),
    "M2": (0, 1),
    "M3": (0, 2),
    "M4": (1, 1),
    "In1": (-1, 0),
    "In2": (0, 0),
    "In3": (1, 0),
}
_SPRINGS = [
    ("M1", "M2"),
    ("M2", "M4"),
    ("M2", "M3"),
    ("M1", "M3"),
    ("M3", "M4"),
    ("M1", "In1"),
    ("M2", "In2"),
    ("M4", "In3"),
    # Differs from [paper]: two braces; without them, pokes of 10 m/s² overturn the phantom.
    ("M1", "In2"),
    ("M4", "In2"),
]
OUTER = ("M1", "M3", "M4")
"""Masses of the phantom whose marks a camera sees."""

HIDDEN = "M2"
"""Hidden mass of the phantom: the target."""


def four_mass_phantom() -> MassSpringNetwork:
    """The paper's phantom at rest under gravity: visible masses M1, M3, M4, hidden mass M2, anchors In1, In2, In3.

    Rest lengths are the distances between neighbours on the grid.
    """
    names = tuple(_PLACES)
    grid = SPACING_M * np.array(list(_PLACES.values()), dtype=float)
    springs = np.array([(names.index(a), names.index(b)) for a, b in _SPRINGS])
    n_nodes, n_springs = len(names), len(springs)
    fixed = np.array([name.startswith("In") for name in names])
    network = MassSpringNetwork(
        names=names,
        positions=grid,
        masses=np.full(n_nodes, MASS_KG),
        fixed=fixed,
        drag=np.where(fixed, 0.0, DRAG_N_S_M),
        friction=np.where(fixed, 0.0, FRICTION_N),
        springs=springs,
        stiffness=np.full(n_springs, STIFFNESS_N_M),
        rest_lengths=spring_lengths(grid, springs),
        damping=np.full(n_springs, DAMPING_N_S_M),
        gravity=np.array([0.0, -9.81]),
    )
    return replace(network, positions=rest_shape(network))
