"""A lung as a network without anchors: springs along the edges of a Delaunay mesh of its landmarks."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from dynamics import MassSpringNetwork, build_network
from experiments.arrays import Floats


@dataclass(frozen=True, slots=True)
class LungConstants:
    """Constants, which are the same for all lungs.

    strand_n: stiffness of a spring times its length [N], for a strand of 20 mm x 20 mm with 2 kPa; choice
    damping_s: dashpot of a spring divided by its stiffness [s], because air and blood follow slowly; choice
    mass_kg: mass of a lung, spread evenly over its landmarks [kg]; choice
    reading_sd_m: sd of a landmark's read position on each axis [m]; source: readers differ by about 1 mm
    """

    strand_n: float = 0.8
    damping_s: float = 0.1
    mass_kg: float = 0.5
    reading_sd_m: float = 1e-3


def node_name(landmark: int) -> str:
    """Name of a landmark's node."""
    return f"L{landmark}"


def edges_of(points: Floats) -> NDArray[np.int64]:
    """Edges of the Delaunay tetrahedra of points (n, 3), each once, (n_edges, 2)."""
    tetrahedra = Delaunay(points).simplices
    pairs = np.concatenate([tetrahedra[:, pair] for pair in combinations(range(4), 2)])
    return np.unique(np.sort(pairs, axis=1), axis=0).astype(np.int64)


def lung_network(points: Floats, constants: LungConstants) -> MassSpringNetwork:
    """The network with nodes at these points, its rest shape [m], (n, 3); without gravity."""
    n = len(points)
    springs = edges_of(points)
    lengths = np.linalg.norm(points[springs[:, 1]] - points[springs[:, 0]], axis=1)
    stiffness = constants.strand_n / lengths
    return build_network(
        list(map(node_name, range(n))),
        points,
        springs.tolist(),
        stiffness=stiffness,
        damping=constants.damping_s * stiffness,
        masses=constants.mass_kg / n,
        rest_lengths=lengths,
        gravity=np.zeros(3),
    )
