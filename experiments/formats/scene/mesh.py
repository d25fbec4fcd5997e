"""Reading and writing of `[mesh]` of a scene file. The named points of the mesh become the nodes of a network."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import count
from pathlib import Path, PurePath

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist, pdist, squareform

from dynamics import MassSpringNetwork
from dynamics.elements import LEFT_OUT, NEAR, continuum_network, points_of
from dynamics.mesh import INSIDE, MeshError, TetMesh, Tissue, locate_on_surface, nearest_elements, surface
from experiments.arrays import Floats
from experiments.errors import InputError, shown
from experiments.formats.mesh.project_file import ProjectMesh, held, mesh_of
from experiments.formats.mesh.reduced import reduced
from experiments.formats.scene.network import check_name
from experiments.formats.scene.schema import MeshPointTable, MeshTable, MeshTissueTable, SceneError, check_own_names
from experiments.formats.toml_file import key_lines

LINE = "needle"
"""Beginning of the names of points that are added along the needle's line, such as `needle 1`."""

SPACING, EDGES = 0.05, 1.5
"""The spacing of points on the needle's line is SPACING times the body's extent, but at least EDGES times an element's
edge. Choice: the needle's force is spread over about this spacing. Points in one element move together."""

APART_M = 1e-5
"""Two points coincide if their distance is less than this [m]; choice: less than the accuracy of any mark."""

MOVES = 0.1
"""Least sum of a new point's weights for free nodes [1]; choice: other points move like the wall."""

ON_SKIN_M = 1e-3
"""Largest distance from the body at which a point counts as a point on the skin [m]; choice: entries are rounded."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneMesh:
    """The mesh of a scene.

    file: name of the mesh file, which lies beside the scene's file
    content: bytes of the mesh file
    fixed: text that selects the fixed nodes, see `held`; None if no nodes are fixed
    driven: whether the fixed nodes move together as a rigid body; the motion is unknown
    regions: for each tissue, the number of its region in the mesh
    points: names and positions of the marks and the target [m]
    stiffness: trace of each tissue's reduced stiffness matrix before identification [1/s²], (n_tissues,)
    """

    file: str
    content: bytes
    fixed: str | None
    driven: bool
    tissues: tuple[Tissue, ...]
    regions: tuple[int, ...]
    points: tuple[tuple[str, tuple[float, ...]], ...]
    stiffness: Floats

    def tissues_of(self, network: MassSpringNetwork) -> tuple[Tissue, ...]:
        """The tissues with Young's moduli that give this network's stiffness, for example after an identification.

        The damping does not change. Therefore the ratio damping_s changes inversely to the stiffness. A tissue whose
        nodes are all fixed has no stiffness and keeps its constants.
        """
        factors = np.divide(_traces(network), self.stiffness, out=np.ones(len(self.tissues)), where=self.stiffness > 0)
        return tuple(
            replace(tissue, young_pa=tissue.young_pa * factor, damping_s=tissue.damping_s / factor)
            for tissue, factor in zip(self.tissues, factors.tolist(), strict=True)
        )

    def in_all_responses(self, network: MassSpringNetwork) -> MassSpringNetwork:
        """The network on a still wall, including the modes that `LEFT_OUT` omits. It simulates true motions."""
        still = {"driven": None if self.fixed is None else False}
        table, points = (
            self.table(network).model_copy(update=still),
            {name: np.array(place) for name, place in self.points},
        )
        made = _made(mesh_of(self.content, Path(self.file)), table, self.tissues_of(network), points, left_out=0.0)
        return replace(made, masses=network.masses)

    def table(self, network: MassSpringNetwork, further: Sequence[tuple[str, Floats]] = ()) -> MeshTable:
        """The table `[mesh]` with the stiffness of the network. `further`: names and positions of more points [m]."""
        tissues = dict(zip(self.regions, self.tissues_of(network), strict=True))
        return mesh_table(self.file, self.fixed, tissues, [*self.points, *further], driven=self.driven)


def _traces(network: MassSpringNetwork) -> Floats:
    if network.continuum is None:
        raise SceneError("mesh: expected a network of the mesh, found one of springs")
    return np.trace(network.continuum.by_tissue, axis1=1, axis2=2)


def mesh_network(content: bytes, path: Path, table: MeshTable) -> tuple[SceneMesh, MassSpringNetwork]:
    """The mesh of a table `[mesh]` and its network; `content` is the mesh file. Raises SceneError or InputError."""
    sha256 = hashlib.sha256(content).hexdigest()
    if table.sha256 is not None and table.sha256 != sha256:
        raise InputError.at(path, f"the mesh of SHA-256 {table.sha256[:12]}…, as the scene states", f"{sha256[:12]}…")
    check_own_names("mesh.tissue", [tissue.name for tissue in table.tissue])
    check_own_names("mesh.point", [point.name for point in table.point])
    for i, point in enumerate(table.point):
        check_name(f"mesh.point[{i}].name", point.name)
        if point.name.startswith("wall "):
            raise SceneError(f"mesh.point[{i}].name: expected a name that no anchor has, found {shown(point.name)}")
    tissues = tuple(
        Tissue(one.name, 1e3 * one.young_kpa, one.poisson, one.density_kg_m3, one.damping_s) for one in table.tissue
    )
    points = {point.name: 1e-3 * np.array(point.position_mm) for point in table.point}
    key = {
        "mesh": sha256,
        "fixed": table.fixed,
        "driven": table.wall_moves,
        "regions": [one.region for one in table.tissue],
        "tissues": [asdict(tissue) for tissue in tissues],
        "points": [[point.name, point.position_mm] for point in table.point],
    }
    network = reduced(key, lambda: _made(mesh_of(content, path), table, tissues, points))
    regions = tuple(one.region for one in table.tissue)
    places = tuple((name, tuple(place.tolist())) for name, place in points.items())
    name = PurePath(table.file).name
    return SceneMesh(name, content, table.fixed, table.wall_moves, tissues, regions, places, _traces(network)), network


def outside_m(mesh: SceneMesh, places: Floats) -> Floats:
    """Distance of each of the positions `places` [m], (n, 3), from the body [m], (n,). Inside the body it is 0."""
    return _outside_m(mesh_of(mesh.content, Path(mesh.file)).mesh, places)


def _outside_m(solid: TetMesh, places: Floats) -> Floats:
    inside = nearest_elements(solid, places)[1].min(axis=1) >= INSIDE
    return np.where(inside, 0.0, locate_on_surface(solid, surface(solid).faces, places)[2])


def with_line(mesh: SceneMesh, network: MassSpringNetwork, ends: Floats) -> tuple[SceneMesh, MassSpringNetwork]:
    """Mesh and network with additional, equally spaced points on the straight line between `ends` [m], (2, 3).

    A new point is omitted if it is outside the body, if nodes around it are fixed, or if an existing free point is
    nearer than half the spacing.
    Each new point has the same mass as the existing points.
    """
    own = mesh_of(mesh.content, Path(mesh.file))
    solid, is_free = own.mesh, np.ones(len(own.mesh.nodes))
    if mesh.fixed is not None:
        is_free[held(own, mesh.fixed)] = 0.0
    edges = np.diff(solid.nodes[solid.elements[:, :2]], axis=1)
    extent_m, edge_m = np.linalg.norm(np.ptp(solid.nodes, axis=0)), np.median(np.linalg.norm(edges, axis=2))
    spacing_m = max(SPACING * float(extent_m), EDGES * float(edge_m))
    length_m = float(np.linalg.norm(ends[1] - ends[0]))
    line = ends[0] + np.arange(0.0, length_m, spacing_m)[:, None] / length_m * (ends[1] - ends[0])
    near = _outside_m(solid, line) < min(ON_SKIN_M, NEAR * float(extent_m))
    near &= cdist(line, network.positions[network.free]).min(axis=1) >= 0.5 * spacing_m
    line = line[near]
    line = line[points_of(solid, surface(solid), line).weights @ is_free > MOVES]
    taken = set(network.names)
    names = (name for k in count(1) if (name := f"{LINE} {k}") not in taken)
    further = list(zip(names, line, strict=False))
    longer, made = mesh_network(mesh.content, Path(mesh.file), mesh.table(network, further))
    return longer, replace(made, masses=np.full(made.n_nodes, network.masses[0]))


def mesh_table(
    file: str,
    fixed: str | None,
    tissues: Mapping[int, Tissue],
    points: Sequence[tuple[str, Sequence[float] | Floats]],
    *,
    driven: bool,
) -> MeshTable:
    """The table `[mesh]` with tissues by region number, and with names and positions of points [m]."""
    return MeshTable(
        file=file,
        fixed=fixed,
        driven=None if fixed is None else driven,
        tissue=[
            MeshTissueTable(
                name=one.name,
                region=region,
                young_kpa=1e-3 * one.young_pa,
                poisson=one.poisson,
                density_kg_m3=one.density_kg_m3,
                damping_s=one.damping_s,
            )
            for region, one in tissues.items()
        ],
        point=[
            MeshPointTable(name=name, position_mm=(np.round(1e3 * np.array(place), 9) + 0.0).tolist())
            for name, place in points
        ],
    )


def _made(
    of: ProjectMesh,
    table: MeshTable,
    tissues: Sequence[Tissue],
    points: Mapping[str, Floats],
    *,
    left_out: float = LEFT_OUT,
) -> MassSpringNetwork:
    """The network whose nodes are these points of a mesh [m]; raises SceneError."""
    own = _numbered(of, table)
    if table.driven and table.fixed is None:
        raise SceneError("mesh.driven: expected the wall that moves in mesh.fixed, found none")
    try:
        fixed = np.empty(0, dtype=np.int64) if table.fixed is None else held(of, table.fixed)
    except ValueError as error:
        raise SceneError(f"mesh.fixed: {error}") from None
    try:
        _check_apart(own, points)
        return continuum_network(own.mesh, tissues, fixed, points, driven=table.wall_moves, left_out=left_out)
    except MeshError as error:
        raise SceneError(_placed(of, points) or f"mesh: {error}") from None


def _numbered(of: ProjectMesh, table: MeshTable) -> ProjectMesh:
    """The mesh with its regions numbered in the order of the tissues; SceneError for a region without a tissue."""
    numbers = [tissue.region for tissue in table.tissue]
    for i, number in enumerate(numbers):
        if numbers.index(number) < i:
            first = f"mesh.tissue[{numbers.index(number)}]"
            raise SceneError(f"mesh.tissue[{i}].region: expected a unique region, found that of {first}")
        if not (of.mesh.regions == number).any():
            has = ", ".join(map(str, np.unique(of.mesh.regions)))
            raise SceneError(f"mesh.tissue[{i}].region: expected a region of the mesh, {has}, found {number}")
    found = np.full(len(of.mesh.regions), -1)
    for i, number in enumerate(numbers):
        found[of.mesh.regions == number] = i
    if (found < 0).any():
        raise SceneError(f"mesh.tissue: expected a tissue for region {of.mesh.regions[found.argmin()]}, found none")
    return replace(of, mesh=replace(of.mesh, regions=found))


def coinciding(places: Floats) -> NDArray[np.int64]:
    """Indices (k, 2) of pairs of points that are less than `APART_M` apart; places: (n, 3) [m]."""
    return np.argwhere(np.triu(squareform(pdist(places)) < APART_M, 1))


def _check_apart(of: ProjectMesh, points: Mapping[str, Floats]) -> None:
    """Raise SceneError if two points of a mesh coincide, and MeshError if a point is outside the mesh."""
    names, places = list(points), np.array(list(points.values()), dtype=float).reshape(-1, 3)
    for first, i in coinciding(points_of(of.mesh, surface(of.mesh), places).places)[:1]:
        found = f"{shown(names[i])} at that of {shown(names[first])}"
        raise SceneError(f"mesh.point[{i}].position_mm: expected a unique position, found {found}")


def _placed(of: ProjectMesh, points: Mapping[str, Floats]) -> str | None:
    """The error message for the first point outside of a mesh; None if all points are inside."""
    outside = surface(of.mesh)
    for i, place in enumerate(points.values()):
        try:
            points_of(of.mesh, outside, place[None])
        except MeshError:
            found = np.round(1e3 * place, 3).tolist()
            return f"mesh.point[{i}].position_mm: expected a place inside the mesh or on its surface, found {found}"
    return None


def mesh_lines(mesh: SceneMesh, network: MassSpringNetwork) -> list[str]:
    """Lines of the table `[mesh]`, with the stiffness of the network."""
    table, sha256 = mesh.table(network), hashlib.sha256(mesh.content).hexdigest()
    keys = {"file": table.file, "sha256": sha256, "fixed": table.fixed, "driven": table.driven}
    lines = ["[mesh]", *key_lines(keys)]
    for tissue in table.tissue:
        lines += ["", "[[mesh.tissue]]", *key_lines(tissue.model_dump())]
    for point in table.point:
        lines += ["", "[[mesh.point]]", *key_lines(point.model_dump())]
    return lines
