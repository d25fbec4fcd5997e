"""Flat phantom like the one in [paper], with 4 to 60 masses in staggered rows above the floor.

The constants below define this phantom; they are not settings.
"""

from __future__ import annotations

import numpy as np

from dynamics.equilibrium.build import build_network
from dynamics.network.mass_spring import NetworkError, spring_lengths
from dynamics.phantoms.lattice import GRAVITY_M_S2, Phantom, delaunay_springs

SPACING_M = 0.120
"""Spacing of neighbours in a row [m]. Each row is half a spacing above the row below, and shifted by half a spacing."""

MASS_KG = 0.1
STIFFNESS_N_M = 40.0
"""Stiffness of each spring, divided by the number of masses [N/m]. Phantoms then sag by about 10 % of the spacing."""

DAMPING_S = 0.0025
"""Damping of a dashpot divided by the stiffness of its spring [s]."""

DRAG_N_S_M = 0.1
FRICTION_N = 0.01
FEWEST, MOST = 4, 60
SLENDER = 1.7
"""Number of masses divided by the square of the number in a full row; at 1.7, the phantom is as high as wide."""


def planar_phantom(n_masses: int = 5) -> Phantom:
    """A flat phantom at rest under gravity, with the innermost mass hidden; NetworkError unless 4 <= n_masses <= 60."""
    if not FEWEST <= n_masses <= MOST:
        raise NetworkError(f"masses: expected {FEWEST} to {MOST} of a planar phantom, found {n_masses}")
    masses, rim, wide = _rows(n_masses)
    floor = [((i - 0.5 * wide) * SPACING_M, 0.0) for i in range(wide + 1)]
    positions = np.array([*masses, *floor])
    fixed = np.arange(len(positions)) >= n_masses
    springs = delaunay_springs(positions, fixed)
    springs = springs[spring_lengths(positions, springs) < 1.1 * SPACING_M]
    stiffness = STIFFNESS_N_M * n_masses
    names = [*(f"M{i + 1}" for i in range(n_masses)), *(f"In{i + 1}" for i in range(wide + 1))]
    network = build_network(
        names,
        positions,
        [(i, j) for i, j in springs.tolist()],
        stiffness=stiffness,
        masses=np.where(fixed, 0.0, MASS_KG),
        gravity=[0.0, -GRAVITY_M_S2],
        fixed=names[n_masses:],
        damping=DAMPING_S * stiffness,
        drag=np.where(fixed, 0.0, DRAG_N_S_M),
        friction=np.where(fixed, 0.0, FRICTION_N),
    )
    inside = [i for i in range(n_masses) if i not in rim] or range(n_masses)
    middle = positions[:n_masses].mean(axis=0)
    target = min(inside, key=lambda i: float(np.round(np.linalg.norm(positions[i] - middle), 9)))
    return Phantom(
        network=network,
        target=network.names[target],
        outer=tuple(network.names[i] for i in sorted(rim - {target})),
        groups=("springs",) * len(springs),
    )


def _rows(n_masses: int) -> tuple[list[tuple[float, float]], set[int], int]:
    """Positions of the masses [m], row by row from below; indices of masses on the rim; length of a full row."""
    wide = max(2, int(np.ceil(np.sqrt(n_masses / SLENDER))))
    rows: list[list[float]] = []
    while (left := n_masses - sum(map(len, rows))) > 0:
        own = wide - len(rows) % 2
        across = sorted(((i - 0.5 * (own - 1)) * SPACING_M for i in range(own)), key=lambda x: (abs(x), x))
        rows.append(sorted(across[:left]))
    places: list[tuple[float, float]] = []
    rim: set[int] = set()
    for r, row in enumerate(rows):
        for k, x in enumerate(row):
            if r in (0, len(rows) - 1) or (k in (0, len(row) - 1) and len(row) > 1):
                rim.add(len(places))
            places.append((x, 0.5 * SPACING_M * (r + 1)))
    return places, rim, wide
