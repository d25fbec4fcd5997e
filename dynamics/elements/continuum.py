"""Reduction of a tissue mesh to a network of points: vibration modes, and a stiffness matrix of the points.

A single point of a continuum has no finite stiffness: the finer the mesh, the deeper a point force dents it. Unknown
forces are therefore smooth fields over the free surface. The modes span the body's responses to these forces and to
changes of gravity's direction. The modes of a free body also span its affine motions. The projection on these
responses follows [benner2015].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.spatial.distance import cdist

from dynamics.arrays import Floats
from dynamics.mesh import (
    INSIDE,
    MeshCholesky,
    MeshError,
    Strains,
    Surface,
    TetMesh,
    Tissue,
    far_apart,
    locate_on_surface,
    lumped_masses,
    nearest_elements,
    patches,
    strains,
    surface,
)
from dynamics.network import Continuum, MassSpringNetwork
from dynamics.network.continuum import FREE
from dynamics.threads import one_blas_thread

NEARLY_INCOMPRESSIBLE = 0.46
"""Poisson's ratio above which the dilatation is averaged over patches of elements [1]; choice: below this ratio, linear
tetrahedra bend well enough without patches, which would make the Cholesky factors larger."""

SMOOTH = 0.2
"""Correlation length of surface forces, relative to the body's extent [1]; choice."""

FUNCTIONS = 30
"""Number of functions that span the surface forces along each axis; numerical: 60 functions with a correlation
length of 0.15 give the same target estimates in blocks and breasts."""

SAMPLES = 500
"""Approximate number of surface nodes from which the functions of the surface forces are computed; numerical."""

LEFT_OUT = 3e-3
"""A mode is omitted if it moves the marks and targets by less than this share of the body's extent (root mean square);
numerical. `POKE_M_S2` and `BENT` define the surface forces that cause this motion."""

POKE_M_S2, BENT = 5.0, 0.1
"""The surface force that selects the modes is POKE_M_S2 [m/s²] times the body's mass; choice. For a stiff body, the
force is increased until it moves the marks and targets by BENT times the body's extent."""

DEPENDENT = 1e-5
"""A direction is omitted as linearly dependent if its singular value is below this share of the largest; numerical."""

NEAR = 0.02
"""A point outside the body has the displacement of the nearest surface point if its distance from that point is at most
this share of the body's extent [1]; choice: some millimetres, because measured marks may lie off a coarse surface."""

PATCH = 0.05
"""Radius of the patch over which a force on a point is spread, divided by the body's extent; choice: a fingertip."""

HARDLY = 1e-3
"""A point is fixed if the sum of its weights for the free nodes is below this [1]; numerical: because of rounding, this
sum is not exactly 0 for a fixed point."""

CHUNK = 2**16
"""Number of strains in a chunk; numerical: memory holds the strains of only one chunk at a time."""

WALL = 12
"""Largest number of network nodes that show where the body is fixed."""


class Points(NamedTuple):
    """Positions of points [m], (k, 3), and weights, (k, n_nodes): each point is a weighted mean of the mesh's nodes."""

    places: Floats
    weights: csr_array


def points_of(mesh: TetMesh, outside: Surface, places: Floats) -> Points:
    """Points of a mesh at given places [m], (k, 3). Places just outside the mesh are moved to its surface.

    Raises MeshError for a place whose distance from the surface exceeds `NEAR` times the body's extent.
    """
    elements, within = nearest_elements(mesh, places)
    near = within.min(axis=1) < INSIDE
    faces, on, away = locate_on_surface(mesh, outside.faces, places[near])
    for place, far in zip(places[near], away, strict=True):
        if far > NEAR * _extent(mesh.nodes):
            found = f"{np.round(1e3 * place, 3)} mm, {1e3 * far:.3g} mm outside"
            raise MeshError(f"points: expected each inside the mesh or near its surface, found {found}")
    inner, elements, within = np.flatnonzero(~near), elements[~near], within[~near]
    rows = [np.repeat(np.flatnonzero(near), 3), np.repeat(inner, 4)]
    columns = [outside.faces[faces].ravel(), mesh.elements[elements].ravel()]
    entries = np.concatenate([on.ravel(), within.ravel()]), (np.concatenate(rows), np.concatenate(columns))
    weights = csr_array(entries, shape=(len(places), len(mesh.nodes)))
    return Points(np.asarray(weights @ mesh.nodes), weights)


def dilatation_patches(mesh: TetMesh, poisson: Floats) -> NDArray[np.int64]:
    """Index of each element's patch, (m,); the dilatation is averaged over a patch. poisson: Poisson's ratios, (m,)."""
    return patches(mesh) if poisson.max() > NEARLY_INCOMPRESSIBLE else np.arange(len(mesh.elements))


def patch_weights(mesh: TetMesh, outside: Surface, named: Points) -> csr_array:
    """Weights that distribute a force on each of k points over the nodes of a patch around it, (k, n_nodes).

    For a point on the surface, the patch contains the surface nodes nearby, weighted by their areas. For a point
    inside, the patch contains all nodes nearby, weighted by their volumes.
    """
    on_surface = np.zeros(len(mesh.nodes))
    on_surface[outside.nodes] = outside.areas
    inside, found = lumped_masses(mesh, 1.0), np.zeros(named.weights.shape)
    for k, (place, own) in enumerate(zip(named.places, named.weights.toarray(), strict=True)):
        sizes = on_surface if on_surface[own > HARDLY].all() else inside
        apart = np.linalg.norm(mesh.nodes - place, axis=1) / (PATCH * _extent(mesh.nodes))
        weights = np.where(apart < 1.0, (1.0 - apart**2) ** 2, 0.0) * sizes
        found[k] = weights / weights.sum() if np.count_nonzero(weights) > 1 else own
    return csr_array(found)


def continuum_network(
    mesh: TetMesh,
    tissues: Sequence[Tissue],
    fixed: NDArray[np.int64],
    points: Mapping[str, Floats],
    *,
    driven: bool = False,
    left_out: float = LEFT_OUT,
) -> MassSpringNetwork:
    """Reduce a mesh to vibration modes. The free nodes of the returned network are named points of the mesh.

    Parameters
    ----------
    mesh : TetMesh
        The body. It rests as drawn under any gravity.
    tissues : sequence of Tissue
        Tissues in the order of the region numbers.
    fixed : (n_fixed,) int
        Fixed nodes of the mesh; empty for a free body.
    points : mapping of str to (3,)
        Rest positions of marks on the surface and of targets inside, by name [m]. A point just outside the mesh has the
        displacement of the nearest surface point. The other nodes of the network, `wall 1` and so on, show where the
        body is fixed.
    driven : bool
        Whether the fixed nodes are a wall that moves as a rigid body in an unknown way.
    left_out : float
        Modes below this threshold [1] are omitted, see `LEFT_OUT`. With 0, only linearly dependent modes are omitted.

    Returns
    -------
    MassSpringNetwork

    Raises
    ------
    MeshError
        If a region has no tissue, no node is free, a point is outside the mesh, or a driven wall has no nodes.
    """
    if mesh.regions.min() < 0 or mesh.regions.max() >= len(tissues):
        found = f"{mesh.regions.min()} to {mesh.regions.max()}"
        raise MeshError(f"regions: expected 0 to {len(tissues) - 1}, found {found}")
    free = np.setdiff1d(np.arange(len(mesh.nodes)), fixed)
    if not len(free):
        raise MeshError("fixed: expected free nodes beside those that are held, found none")
    if driven and not len(fixed):
        raise MeshError("driven: expected the nodes of a wall, found none")
    outside = surface(mesh)
    places = np.array(list(points.values()), dtype=float).reshape(-1, 3)
    named = points_of(mesh, outside, places)
    with one_blas_thread():
        solid = _continuum(mesh, tissues, free, outside, named, left_out)
    wall = np.asarray(fixed)[far_apart(mesh.nodes[fixed], WALL)] if len(fixed) else np.empty(0, dtype=np.int64)
    k, n = len(points), len(points) + len(wall)
    return MassSpringNetwork(
        names=(*points, *(f"wall {i}" for i in range(1, len(wall) + 1))),
        positions=np.concatenate([places, mesh.nodes[wall]]),
        masses=np.full(n, solid.mass / k),
        fixed=np.arange(n) >= k,
        drag=np.zeros(n),
        friction=np.zeros(n),
        springs=np.empty((0, 2), dtype=np.int64),
        stiffness=np.empty(0),
        rest_lengths=np.empty(0),
        damping=np.empty(0),
        gravity=np.zeros(3),
        continuum=solid.with_driven_wall(places) if driven else solid,
    )


def _continuum(
    mesh: TetMesh,
    tissues: Sequence[Tissue],
    free: NDArray[np.int64],
    outside: Surface,
    named: Points,
    left_out: float,
) -> Continuum:
    young, poisson, density, damping_s = (
        np.array([getattr(tissue, key) for tissue in tissues])[mesh.regions]
        for key in ("young_pa", "poisson", "density_kg_m3", "damping_s")
    )
    patch = dilatation_patches(mesh, poisson)
    masses, extent_m = lumped_masses(mesh, density)[free], _extent(mesh.nodes)
    strained = strains(mesh, young, poisson, free, patch)
    K = strained.stiffness
    cells = csr_array((np.ones(4 * len(patch)), (np.repeat(patch, 4), mesh.elements.ravel())))[:, free]
    factor = MeshCholesky(K + FREE**2 * diags_array(np.repeat(masses, 3)), mesh.nodes[free], cells)
    place = np.full(len(mesh.nodes), -1)
    place[free] = np.arange(len(free))
    areas = np.zeros(len(free))
    moves = place[outside.nodes] >= 0
    areas[place[outside.nodes[moves]]] = outside.areas[moves]
    pushed, nodes = np.flatnonzero(areas), mesh.nodes[free]
    fields = np.zeros((len(free), 1 + FUNCTIONS))
    fields[:, 0] = masses  # on the whole body, like a change of gravity's direction
    fields[pushed, 1:] = _smooth(nodes[pushed], SMOOTH * extent_m, FUNCTIONS)
    fields[:, 1:] *= (areas * masses.sum() / areas.sum())[:, None]
    forces = np.asarray(np.kron(fields, np.eye(3)), dtype=float)
    moved = factor.solve(forces)
    weights = csr_array(named.weights[:, free])
    still = np.flatnonzero(weights.sum(axis=1) < HARDLY)
    if len(still):
        found = f"{np.round(1e3 * named.places[still[0]], 3)} mm"
        raise MeshError(f"points: expected each where the mesh moves, found {found} where it is held")
    rows = _by_axis(weights)
    at_points = np.asarray(rows @ moved)
    V, rates = _modes(nodes, masses, K, len(free) < len(mesh.nodes), moved, at_points, left_out)
    total, shapes = float(masses.sum()), np.asarray(rows @ V)
    by_field = V.T @ forces / total
    by_tissue = _by_tissue(strained, mesh.regions, V, len(tissues)) / total
    by_damping = np.einsum("t,tij->ij", [tissue.damping_s for tissue in tissues], by_tissue)
    near = csr_array(patch_weights(mesh, outside, named)[:, free]).toarray()
    is_held = near.sum(axis=1) < HARDLY  # all of the patch is fixed: the force acts on the point's own nodes
    spread = _by_axis(csr_array(np.where(is_held[:, None], weights.toarray(), near)))
    compliance = np.asarray(spread @ factor.solve(np.asarray(spread.T.todense())))
    stiffness = np.linalg.inv(0.5 * (compliance + compliance.T))
    return Continuum(
        tissues=tuple(tissue.name for tissue in tissues),
        mass=total,
        extent_m=extent_m,
        masses=np.full(len(rates), total),
        shapes=shapes,
        rates=rates,
        damping=by_damping.diagonal().copy(),
        by_tissue=by_tissue,
        forces=by_field,
        omitted=at_points - shapes @ (by_field / (rates + FREE**2)[:, None]),
        stiffness=0.5 * (stiffness + stiffness.T),
        dashpots=float(damping_s.mean()) * 0.5 * (stiffness + stiffness.T),
    )


def _extent(nodes: Floats) -> float:
    return float(np.linalg.norm(np.ptp(nodes, axis=0)))


def _by_axis(weights: csr_array) -> csr_array:
    """Weights of the coordinates, (3 k, 3 n), from weights of the nodes, (k, n), which are used for each axis."""
    entries = weights.tocoo()
    rows, columns = (3 * index[:, None] + np.arange(3) for index in (entries.row, entries.col))
    shape = (3 * weights.shape[0], 3 * weights.shape[1])
    return csr_array((np.repeat(entries.data, 3), (rows.ravel(), columns.ravel())), shape=shape)


def matern(distances: Floats, length: float) -> Floats:
    """Matern's 3/2 correlation at given distances; length: correlation length, in the unit of the distances."""
    scaled = np.sqrt(3.0) * distances / length
    return np.asarray((1.0 + scaled) * np.exp(-scaled))


def _smooth(places: Floats, length: float, count: int) -> Floats:
    """Functions of n places, as columns (n, count), by Nystroem's method; places: (n, 3).

    A sum of these functions with independent standard normal factors has Matern's 3/2 correlation and variance 1.
    """
    some = places[:: max(1, len(places) // SAMPLES)]
    least = max(0, len(some) - count)
    values, vectors = eigh(matern(cdist(some, some), length), subset_by_index=(least, len(some) - 1))
    values, vectors = values[::-1], vectors[:, ::-1]
    kept = values > 1e-6 * values[0]
    columns = matern(cdist(places, some), length) @ (vectors[:, kept] / np.sqrt(values[kept]))
    found = np.zeros((len(places), count))
    found[:, : columns.shape[1]] = columns
    return found


def _modes(
    nodes: Floats, masses: Floats, K: csc_array, held: bool, responses: Floats, at_points: Floats, left_out: float
) -> tuple[Floats, Floats]:
    """Vibration modes (3 n, r), and the squares of their angular frequencies [1/s²], (r,).

    The modes span the `responses` to forces, (3 n, n_responses). Combinations of responses that hardly move marks or
    targets are omitted. If the body is not held, the modes also span its affine motions.
    at_points: displacement of the marks and targets in each response, (3 k, n_responses)
    """
    root = np.sqrt(np.repeat(masses, 3) / masses.sum())[:, None]
    _, sizes, right = np.linalg.svd(at_points, full_matrices=False)
    each, extent_m = sizes * np.sqrt(3.0 / len(at_points)), _extent(nodes)
    shown = each * max(POKE_M_S2, BENT * extent_m / each[0]) > left_out * extent_m
    basis = responses @ right[shown].T
    if not held:
        affine = np.kron(np.column_stack([np.ones(len(nodes)), nodes - nodes.mean(axis=0)]), np.eye(3))
        basis = np.hstack([basis, affine])
    vectors, sizes, _ = np.linalg.svd(root * basis / np.linalg.norm(root * basis, axis=0), full_matrices=False)
    own = vectors[:, sizes > DEPENDENT * sizes[0]] / root
    reduced = own.T @ (K @ own)
    rates, turn = eigh(0.5 * (reduced + reduced.T))
    return own @ turn, np.maximum(rates, 0.0) / masses.sum()


def _by_tissue(strained: Strains, regions: NDArray[np.int64], modes: Floats, n_tissues: int) -> Floats:
    """Stiffness of each tissue in the coordinates of the modes [N/m], (n_tissues, r, r)."""
    found = np.zeros((n_tissues, modes.shape[1], modes.shape[1]))
    for some in np.array_split(np.arange(len(strained.weights)), 1 + len(strained.weights) // CHUNK):
        strain, tissue = strained.matrix[some] @ modes, regions[strained.elements[some]]
        for t in range(n_tissues):
            own = tissue == t
            found[t] += strain[own].T @ (strained.weights[some][own, None] * strain[own])
    return found
