"""Breast phantom: a soft hemisphere on a chest wall, with nodes on its skin and inside, and elastic springs.

x points right, y up, z away from the chest wall; gravity points down, as for a standing patient. The constants below
define this phantom; they are not settings.
"""

from __future__ import annotations

import numpy as np

from dynamics.arrays import Floats
from dynamics.network.mass_spring import NetworkError
from dynamics.phantoms.lattice import Phantom, elastic_body

RADIUS_M = 0.060
YOUNG_PA = 5e3
"""Young's modulus of fat and gland together [Pa]. Measured moduli are a few kPa [gefen2007]."""

FEWEST, MOST = 6, 60
SKIN_SHARE = 0.6
"""Share of the masses on the skin; the others are inside."""

N_WALL = 8
"""Number of anchors around the base. One more anchor is in the middle of the base."""

TARGET = (0.15, 0.1, 0.45)
"""Position of the target, relative to the breast's radius."""

INNER = 0.55
"""Distance of the inner masses, except the target, from the middle of the base, relative to the breast's radius."""

GOLDEN = np.pi * (3.0 - np.sqrt(5.0))


def breast_phantom(n_masses: int = 10, young: float = YOUNG_PA) -> Phantom:
    """A breast at rest under gravity, with outer nodes on the skin and the target inside.

    young: Young's modulus [Pa]. Raises NetworkError for fewer than 6 or more than 60 masses, and if the breast is too
    soft to support its weight.
    """
    if not FEWEST <= n_masses <= MOST:
        raise NetworkError(f"masses: expected {FEWEST} to {MOST} of a breast phantom, found {n_masses}")
    n_skin = round(SKIN_SHARE * n_masses)
    skin = RADIUS_M * _dome(n_skin)
    inside = np.vstack([np.array(TARGET), INNER * _dome(n_masses - n_skin - 1)]) * RADIUS_M
    angles = 2.0 * np.pi * np.arange(N_WALL) / N_WALL
    foot = RADIUS_M * np.stack([np.cos(angles), np.sin(angles), np.zeros(N_WALL)], axis=1)
    positions = np.vstack([skin, inside, foot, np.zeros((1, 3))])
    fixed = np.arange(len(positions)) >= n_masses
    names = (
        *(f"S{i + 1}" for i in range(n_skin)),
        "T",
        *(f"F{i + 1}" for i in range(n_masses - n_skin - 1)),
        *(f"W{i + 1}" for i in range(N_WALL + 1)),
    )
    network = elastic_body(names, positions, fixed, young)
    on_skin = [max(pair) < n_skin for pair in network.springs.tolist()]
    return Phantom(
        network=network,
        target="T",
        outer=names[:n_skin],
        groups=tuple("skin" if one else "inside" for one in on_skin),
    )


def _dome(n: int) -> Floats:
    """Points on a spiral, (n, 3), spread evenly over the part of the unit sphere above z = 0.1."""
    z = 1.0 - 0.9 * (np.arange(n) + 0.5) / n
    around = GOLDEN * np.arange(n)
    return np.stack([np.sqrt(1.0 - z**2) * np.cos(around), np.sqrt(1.0 - z**2) * np.sin(around), z], axis=1)
