"""Elastic bodies of springs between given nodes. The springs are stiff enough for a body to rest as drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, Delaunay, QhullError

from dynamics.arrays import Floats
from dynamics.equilibrium.build import build_network
from dynamics.network.mass_spring import MassSpringNetwork, NetworkError, spring_lengths

LONGEST = 2.0
"""Largest length of a spring, divided by the median edge length of the triangulation. Longer edges get no spring."""

DENSITY_KG_M3 = 1000.0
SHEET_M = 0.010
"""Thickness of a body in the plane [m]."""

DAMPING_S = 0.01
"""Damping of a dashpot divided by the stiffness of its spring [s]."""

GRAVITY_M_S2 = 9.81


@dataclass(frozen=True, slots=True, eq=False)
class Phantom:
    """A phantom: a network that rests as drawn, and its target.

    target: name of the hidden target node; outer: names of the free nodes on the outside, which can have marks
    groups: group name of each spring, (n_springs,); a group contains similar springs
    """

    network: MassSpringNetwork
    target: str
    outer: tuple[str, ...]
    groups: tuple[str, ...]


def delaunay_springs(positions: Floats, fixed: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Edges of the Delaunay triangulation, (n_springs, 2), without edges between anchors and without very long edges.

    positions: node positions [m], (n_nodes, dim). Raises NetworkError if all lie on a line or, in space, in a plane.
    """
    n_corners = positions.shape[1] + 1
    try:
        corners = Delaunay(positions).simplices
    except (QhullError, ValueError):
        raise NetworkError(f"nodes: expected {n_corners} or more, not all in a line or plane, found others") from None
    edges = np.vstack([corners[:, [i, j]] for i in range(n_corners) for j in range(i + 1, n_corners)])
    pairs = np.unique(np.sort(edges, axis=1), axis=0)
    lengths = spring_lengths(positions, pairs)
    kept = (lengths <= LONGEST * np.median(lengths)) & ~fixed[pairs].all(axis=1)
    return pairs[kept].astype(np.int64)


def elastic_stiffness(positions: Floats, springs: NDArray[np.int64], young: float) -> float:
    """Stiffness, the same for all springs [N/m], with which a lattice is as stiff as an elastic body.

    positions: positions of the nodes [m], (n_nodes, dim); springs: the two nodes of each spring, (n_springs, 2)
    young: in space, Young's modulus E [Pa]; in the plane, E times the thickness of the sheet [N/m]
    By [vangelder1998], a spring of length l has the stiffness `k = E V / l²`, with V the volume of the simplices around
    it. The returned stiffness is the constant k for which the sum of `k l²` over all springs is the same. Under uniform
    stretch, the lattice is as stiff as a body with E and Poisson's ratio 1/4 in space or 1/3 in the plane.
    """
    dim = positions.shape[1]
    return float(0.5 * dim * (dim + 1) * young * volume(positions) / (spring_lengths(positions, springs) ** 2).sum())


def elastic_body(
    names: Sequence[str],
    positions: Floats,
    fixed: NDArray[np.bool_],
    young: float,
    *,
    springs: NDArray[np.int64] | None = None,
    stiffness: Floats | None = None,
    damping: Floats | None = None,
    masses: Floats | None = None,
) -> MassSpringNetwork:
    """An elastic body that rests under gravity along -y with its nodes at these positions [m], (n_nodes, dim).

    young: Young's modulus [Pa]. In the plane, the body is a sheet of thickness `SHEET_M`.
    springs: the two nodes of each spring, (n_springs, 2); default: `delaunay_springs`
    stiffness, damping: constants of each spring [N/m], [N s/m], (n_springs,); default: from `young` and `DAMPING_S`
    masses: mass of each node [kg], (n_nodes,); default: the free nodes share the mass of a body of water
    Without anchors the body has no weight. Raises NetworkError if the body is too soft to support its weight.
    """
    dim = positions.shape[1]
    thick = 1.0 if dim == 3 else SHEET_M
    pairs = delaunay_springs(positions, fixed) if springs is None else springs
    if stiffness is None:
        stiffness = np.full(len(pairs), elastic_stiffness(positions, pairs, young * thick))
    if masses is None:
        own = DENSITY_KG_M3 * volume(positions) * thick / max(1, int((~fixed).sum()))
        masses = np.where(fixed, 0.0, own)
    return build_network(
        names,
        positions,
        [(i, j) for i, j in pairs.tolist()],
        stiffness=stiffness,
        masses=masses,
        gravity=[0.0, -GRAVITY_M_S2 if fixed.any() else 0.0, 0.0][:dim],
        fixed=[name for name, one in zip(names, fixed, strict=True) if one],
        damping=DAMPING_S * stiffness if damping is None else damping,
    )


def volume(positions: Floats) -> float:
    """Volume [m³] or, in the plane, area [m²] of the nodes' convex hull. Raises NetworkError if the hull is flat."""
    return float(_hull(positions).volume)


def on_hull(positions: Floats) -> NDArray[np.bool_]:
    """Whether each node is a corner of the convex hull of all nodes, (n_nodes,).

    positions: positions of the nodes [m], (n_nodes, dim). Raises NetworkError if the hull has no volume.
    """
    corners = np.zeros(len(positions), dtype=bool)
    corners[_hull(positions).vertices] = True
    return corners


def to_outside(positions: Floats, start: Floats, direction: Floats) -> float:
    """Distance from a point inside the nodes' convex hull to the surface of the hull in a given direction [m].

    positions: positions of the nodes [m], (n_nodes, dim); start: the point [m], (dim,); direction: unit vector, (dim,)
    Raises NetworkError if the hull has no volume.
    """
    facets = _hull(positions).equations
    slopes, depths = facets[:, :-1] @ direction, -(facets[:, :-1] @ start + facets[:, -1])
    return float((depths[slopes > 0.0] / slopes[slopes > 0.0]).min())


def _hull(positions: Floats) -> ConvexHull:
    try:
        return ConvexHull(positions)
    except (QhullError, ValueError):
        raise NetworkError("nodes: expected them not all in a line or plane, found a body without volume") from None
