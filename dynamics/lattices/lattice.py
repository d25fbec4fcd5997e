"""Lattice of a tissue cube: points along the tissue's structure, tetrahedra between points, springs along edges."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.spatial import Delaunay, cKDTree

from dynamics.arrays import Floats
from dynamics.elements import dilatation_patches
from dynamics.equilibrium.build import build_network
from dynamics.lattices.structures import Structure
from dynamics.mesh import TetMesh, Tissue, lumped_masses, rest_stiffness
from dynamics.network import MassSpringNetwork, spring_lengths

Depth = Callable[[Floats], Floats]

JITTER = 0.2
"""Largest random shift of points, relative to a grid cell [1]; choice: a regular grid has flat tetrahedra."""

CLOSEST = 0.45
"""If the distance between two points is below this share of a grid cell, one point is omitted; choice: this avoids flat
tetrahedra."""

FLATTEST = 1e-3
"""A tetrahedron is omitted if its volume divided by the cube of its longest edge is at most this [1]; choice. Together,
the omitted tetrahedra have about 1e-5 of the cube's volume."""

MOVES, STEP = 5, 1e-4
"""MOVES is the number of Newton steps that move a point to a surface. STEP is the half-width of central differences,
relative to the side of the cube [1]. Both are numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Points along the structure of a tissue, with springs along the edges of tetrahedra between the points.

    Attributes
    ----------
    mesh : TetMesh
        A cube with a corner at the origin. Region 0 is the surrounding tissue, other regions belong to the structure.
    springs : (n_springs, 2) int
        Ends of each spring.
    edges : (m, 6) int
        Springs of each tetrahedron.
    depths : (n,)
        Distance of each point to the nearest surface of the structure [m], negative inside.
    alignment : (n_springs,)
        Squared cosine of the angle between the spring and the nearest surface of the structure: 1 for a spring along a
        layer, wall, duct or fibre, 0 for a spring across it, and on average 2/3 for random directions.
    """

    mesh: TetMesh
    springs: NDArray[np.int64]
    edges: NDArray[np.int64]
    depths: Floats
    alignment: Floats

    @property
    def lengths(self) -> Floats:
        """Lengths of the springs [m], (n_springs,)."""
        return spring_lengths(self.mesh.nodes, self.springs)

    @property
    def directions(self) -> Floats:
        """Unit vectors of the springs, from the first end to the second, (n_springs, 3)."""
        return _directions(self.mesh.nodes, self.springs)

    @property
    def crossing(self) -> NDArray[np.bool_]:
        """Whether a spring crosses a surface more than 1 % of the spring's length away from both ends, (n_springs,)."""
        ends = self.depths[self.springs]
        return np.asarray((ends.prod(axis=1) < 0.0) & (np.abs(ends).min(axis=1) > 0.01 * self.lengths))

    def of_elements(self, tissues: Sequence[Tissue], key: str) -> Floats:
        """The constant `key` of the tissue of each element, (m,)."""
        return np.array([getattr(tissue, key) for tissue in tissues])[self.mesh.regions]

    def of_springs(self, shares: Floats) -> Floats:
        """Sum of `shares`, (m,), over the tetrahedra that contain each spring, (n_springs,)."""
        return np.asarray(np.bincount(self.edges.ravel(), np.repeat(shares, 6), minlength=len(self.springs)))

    def element_stiffness(self, tissues: Sequence[Tissue]) -> csc_array:
        """Stiffness matrix of the tetrahedra [N/m], (3 n, 3 n), node-major; tissues: tissue of each region."""
        young, poisson = (self.of_elements(tissues, key) for key in ("young_pa", "poisson"))
        return rest_stiffness(self.mesh, young, poisson, None, dilatation_patches(self.mesh, poisson))


def lattice_of(structure: Structure, side_m: float, cells: int, rng: np.random.Generator) -> Lattice:
    """A lattice whose springs lie along the surfaces of a structure.

    Parameters
    ----------
    structure : Structure
        Distances to the surfaces of the tissues in the unit cube.
    side_m : float
        Side of the cube [m].
    cells : int
        Number of cells along a side. The cube has about (cells + 1)³ points.
    rng : numpy.random.Generator
        Random generator for the points.

    Returns
    -------
    Lattice

    Notes
    -----
    The points of a grid are shifted at random. A point within half a cell of a surface is then moved to the surface.
    Points on a face of the cube stay on this face. Few edges of the points' Delaunay triangulation cross a surface, see
    `Lattice.crossing`.
    """

    def depth(x: Floats) -> Floats:
        return np.asarray(structure(x).min(axis=0))

    x = _points(depth, cells, rng)
    elements = Delaunay(x).simplices.astype(np.int64)
    edges = x[elements[:, 1:]] - x[elements[:, :1]]
    volumes = np.linalg.det(edges) / 6.0
    elements[volumes < 0.0] = elements[volumes < 0.0][:, [1, 0, 2, 3]]
    sides = np.concatenate([edges, edges[:, [1, 2, 0]] - edges], axis=1)
    elements = elements[np.abs(volumes) > FLATTEST * (sides**2).sum(axis=2).max(axis=1) ** 1.5]
    within = structure(x[elements].mean(axis=1))
    mesh = TetMesh(side_m * x, elements, np.where(within.min(axis=0) < 0.0, 1 + within.argmin(axis=0), 0))
    pairs = np.sort(elements[:, np.transpose(np.triu_indices(4, 1))], axis=2)
    springs, which = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    normals = _gradients(depth, x[springs].mean(axis=1))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), STEP)
    alignment = 1.0 - (_directions(x, springs) * normals).sum(axis=1) ** 2
    return Lattice(mesh, springs, which.reshape(-1, 6), side_m * depth(x), alignment)


def lattice_network(lattice: Lattice, stiffness: Floats, tissues: Sequence[Tissue]) -> MassSpringNetwork:
    """The network of a lattice, without anchors and gravity, which rests as drawn.

    stiffness: stiffness of the springs [N/m], (n_springs,)
    tissues: tissue of each region; its density and damping give the masses and dashpots
    """
    volumes = lattice.mesh.volumes
    damping_s = lattice.of_springs(lattice.of_elements(tissues, "damping_s") * volumes) / lattice.of_springs(volumes)
    return build_network(
        [f"n{k}" for k in range(len(lattice.mesh.nodes))],
        lattice.mesh.nodes,
        [(i, j) for i, j in lattice.springs.tolist()],
        stiffness=stiffness,
        masses=lumped_masses(lattice.mesh, lattice.of_elements(tissues, "density_kg_m3")),
        gravity=np.zeros(3),
        damping=stiffness * damping_s,
    )


def _points(depth: Depth, cells: int, rng: np.random.Generator) -> Floats:
    """Points of the unit cube, (n, 3). Points near a surface are moved to this surface."""
    cell, along = 1.0 / cells, np.linspace(0.0, 1.0, cells + 1)
    x = np.stack(np.meshgrid(along, along, along, indexing="ij"), axis=-1).reshape(-1, 3)
    moves = (x > 0.5 * cell) & (x < 1.0 - 0.5 * cell)
    x += np.where(moves, JITTER * cell * rng.uniform(-1.0, 1.0, x.shape), 0.0)
    near = np.abs(depth(x)) < 0.5 * cell
    lowest = np.where(moves[near], 0.25 * cell, 0.0)
    for _ in range(MOVES):
        slopes = _gradients(depth, x[near]) * moves[near]
        step = depth(x[near]) / np.maximum((slopes**2).sum(axis=1), 0.1)
        x[near] -= np.clip(step, -0.5 * cell, 0.5 * cell)[:, None] * slopes
        x[near] = np.clip(x[near], lowest, 1.0 - lowest)
    kept = np.ones(len(x), dtype=bool)
    bound = moves.sum(axis=1)  # a point on an edge or face of the cube stays
    for i, j in sorted(cKDTree(x).query_pairs(CLOSEST * cell)):
        first, second = (i, j) if bound[i] < bound[j] else (j, i)
        kept[second] &= not kept[first]
    return x[kept]


def _directions(x: Floats, springs: NDArray[np.int64]) -> Floats:
    """Unit vectors along springs between points, (n_springs, 3)."""
    return np.asarray((x[springs[:, 1]] - x[springs[:, 0]]) / spring_lengths(x, springs)[:, None])


def _gradients(depth: Depth, x: Floats) -> Floats:
    """Gradients of the distance to the nearest surface, (n, 3), at points, (n, 3), by central differences."""
    return np.stack([(depth(x + step) - depth(x - step)) / (2.0 * STEP) for step in STEP * np.eye(3)], axis=1)
