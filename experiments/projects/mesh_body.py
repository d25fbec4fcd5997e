"""A project of a body of tetrahedra: mesh, tissues, wall, marks and target by the options of `softaim new`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynamics.mesh import MeshError, TetMesh, far_apart, locate, locate_on_surface
from experiments.arrays import Floats
from experiments.errors import InputError, shown
from experiments.formats.mesh.body import Body, read_body
from experiments.formats.mesh.held import FORMS, WALL, held
from experiments.formats.mesh.project_file import ProjectMesh, mesh_content
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.mesh import mesh_network, mesh_table
from experiments.formats.scene.network import is_node_name
from experiments.formats.scene.reference import Reference
from experiments.formats.scene.scene import Scene
from experiments.formats.scene.schema import MeshTable, SceneError
from experiments.formats.scene.target import Target
from experiments.formats.tables import read_table
from experiments.projects.mesh_tissues import assigned
from experiments.projects.template import (
    GROUP_SD,
    HUES_DEG,
    LEAST_REACH_MM,
    MARK_SIZE,
    RADIUS_MM,
    Template,
    aimed,
)

FILE = "mesh.npz"
"""The mesh in the folder of a project."""

N_MARKS = 40
"""Number of marks of a project without a file of them."""

TARGET = "T"

NEAR = 0.05
"""Distance of a mark from the surface, by the extent, to which it is moved onto it; choice: 5 mm of 100 mm."""

SHALLOWEST_MM = 0.01
"""Least depth of a target below the surface: less has no direction to the skin."""


@dataclass(frozen=True, slots=True)
class MeshChoice:
    """The options of `softaim new` for a body of tetrahedra.

    marks: their number, or a file name,x_mm,y_mm,z_mm; target_mm: x,y,z; regions: LABEL=TISSUE
    """

    path: Path
    unit: str | None = None
    size_mm: float | None = None
    fixed: str | None = None
    marks: str = str(N_MARKS)
    target_mm: str | None = None
    target_sd_mm: float | None = None
    field: str | None = None
    regions: tuple[str, ...] = ()


def mesh_template(of: MeshChoice, *, young_pa: float | None, seed: int) -> Template:
    """The project of a body of tetrahedra; raises InputError.

    young_pa: of a body of one tissue
    """
    body = read_body(of.path, of.unit, None if of.size_mm is None else 1e-3 * of.size_mm)
    tissues = assigned(body, of.path, of.field, of.regions, young_pa)
    mesh = replace(body.mesh, regions=tissues.regions)
    wall, fixed = _wall(ProjectMesh(mesh, np.empty(0, dtype=np.int64)), body, of)
    kept = ProjectMesh(mesh, wall)
    faces = _free_faces(body, held(kept, fixed))
    marks = _marks(of.marks, mesh, faces)
    target = _target(of, mesh)
    points = [*marks.items(), (TARGET, target)]
    content = mesh_content(kept)
    assumed = _scene(content, of, mesh_table(FILE, fixed, dict(enumerate(tissues.tissues)), points), marks)
    rng = np.random.default_rng(seed)
    actual = replace(
        tissues,
        tissues=tuple(
            replace(
                one,
                young_pa=one.young_pa * float(np.exp(rng.normal(0.0, GROUP_SD["stiffness"]))),
                damping_s=one.damping_s * float(np.exp(rng.normal(0.0, GROUP_SD["damping"]))),
            )
            for one in tissues.tissues
        ),
    )
    truth = _scene(content, of, mesh_table(FILE, fixed, dict(enumerate(actual.tissues)), points), marks)
    corner, weights, _ = locate_on_surface(mesh, faces, target[None])
    out = np.einsum("kc,kcd->d", weights, mesh.nodes[faces[corner]]) - target
    reach = float(np.linalg.norm(out))
    if reach < 1e-3 * SHALLOWEST_MM:
        raise InputError.at("--target", "a point inside", f"{np.round(1e3 * target, 3)} mm on the surface")
    out /= reach
    entry = target + max(reach, 1e-3 * LEAST_REACH_MM) * out
    counts = f"{len(mesh.nodes)} nodes, {len(mesh.elements)} tetrahedra, {1e6 * mesh.volumes.sum():.4g} ml"
    return Template(
        f"A body of {counts} from {of.path.name}",
        assumed,
        truth,
        entry,
        aimed(assumed.network, TARGET, entry, -out),
    )


def _wall(of: ProjectMesh, body: Body, choice: MeshChoice) -> tuple[NDArray[np.int64], str]:
    """The nodes of labelled faces, and `fixed` of the scene; raises InputError."""
    place, nodes, fixed = "--fixed", of.wall, choice.fixed or ""
    what, _, label = fixed.partition(" ")
    if what == "faces":
        labelled = [values for values in body.faces.fields.values() if label.strip() in {f"{v:g}" for v in values}]
        if not labelled:
            found = sorted({f"{v:g}" for values in body.faces.fields.values() for v in values if np.isfinite(v)})
            raise InputError.at(
                place, "a label of faces in the file", f"{shown(label)}; it has {', '.join(found) or 'none'}"
            )
        nodes, fixed = np.unique(body.faces.nodes[labelled[0] == float(label)]), WALL
    try:
        if choice.fixed is None or (fixed == WALL and what != "faces"):
            low, high = (1e3 * edge for edge in (of.mesh.nodes.min(axis=0), of.mesh.nodes.max(axis=0)))
            axes = ", ".join(f"{axis} is {a:.4g} to {b:.4g} mm" for axis, a, b in zip("xyz", low, high, strict=True))
            raise InputError.at(place, f"where the body is held, {FORMS.replace('wall', 'faces 2')}", f"none; {axes}")
        held(ProjectMesh(of.mesh, nodes), fixed)
    except ValueError as error:
        raise InputError(f"{place}: {error}") from None
    return nodes, fixed


def _free_faces(body: Body, fixed: NDArray[np.int64]) -> NDArray[np.int64]:
    """Faces of the outside with no corner that is held, (k, 3); raises InputError for none."""
    is_held = np.zeros(len(body.mesh.nodes), dtype=bool)
    is_held[fixed] = True
    faces = body.faces.nodes[~is_held[body.faces.nodes].any(axis=1)]
    if not len(faces):
        raise InputError.at("--fixed", "a free surface for marks", "none")
    return faces


def _marks(marks: str, mesh: TetMesh, faces: NDArray[np.int64]) -> dict[str, Floats]:
    """Names and places of marks on the free surface [m]; raises InputError."""
    if not marks.isdecimal():
        return _listed(Path(marks), mesh, faces)
    nodes = np.unique(faces)
    count = int(marks)
    if not 1 <= count <= len(nodes):
        raise InputError.at("--marks", f"1 to {len(nodes)}, or a file of marks", marks)
    places = mesh.nodes[nodes]
    outermost = int(np.linalg.norm(places - places.mean(axis=0), axis=1).argmax())
    chosen = far_apart(places, count, [outermost])
    return {f"M{k}": places[i] for k, i in enumerate(chosen, start=1)}


def _listed(path: Path, mesh: TetMesh, faces: NDArray[np.int64]) -> dict[str, Floats]:
    """The marks of a file, moved onto the free surface."""
    axes = ["x_mm", "y_mm", "z_mm"]
    table = read_table(path, axes, ["name"])
    names = table.texts["name"]
    table.check("name", np.array([is_node_name(name) and name != TARGET for name in names]), "a name for a mark")
    table.check("name", np.array([names.index(name) == i for i, name in enumerate(names)]), "a name of its own")
    if not names:
        raise InputError.at(path, "a row for each mark", "none")
    corner, weights, away = locate_on_surface(
        mesh, faces, 1e-3 * np.stack([table.numbers[axis] for axis in axes], axis=1)
    )
    most = NEAR * float(np.ptp(mesh.nodes, axis=0).max())
    if away.max() > most:
        row = int(away.argmax())
        raise InputError.at(
            table.place(row, "x_mm"),
            f"a place within {1e3 * most:.3g} mm of the free surface",
            f"{1e3 * away[row]:.3g} mm",
        )
    places = np.einsum("kc,kcd->kd", weights, mesh.nodes[faces[corner]])
    return dict(zip(names, places, strict=True))


def _target(of: MeshChoice, mesh: TetMesh) -> Floats:
    """The target's place [m], (3,): that of the option, else the middle of the element next to that of the body."""
    if of.target_mm is None:
        centres = mesh.nodes[mesh.elements].mean(axis=1)
        middle = np.average(centres, axis=0, weights=mesh.volumes)
        return np.asarray(centres[np.linalg.norm(centres - middle, axis=1).argmin()])
    try:
        place = 1e-3 * np.array([float(part) for part in of.target_mm.split(",")])
    except ValueError:
        place = np.empty(0)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise InputError.at("--target", "x,y,z [mm]", shown(of.target_mm))
    try:
        locate(mesh, place[None])
    except MeshError:
        raise InputError.at("--target", f"a place inside {of.path.name}", f"{of.target_mm} mm outside") from None
    return place


def _scene(content: bytes, of: MeshChoice, table: MeshTable, marks: dict[str, Floats]) -> Scene:
    """The scene of a mesh: marks on its surface, that of the target for scoring only."""
    try:
        mesh, network = mesh_network(content, of.path, table)
    except SceneError as error:
        raise InputError(f"{of.path}: {error}") from None
    places = np.array([*marks.values()])
    apart = np.linalg.norm(places[:, None] - places, axis=2) + np.diag(np.full(len(places), np.inf))
    extent = float(np.ptp(places, axis=0).max()) if len(places) > 1 else 0.06
    diameter_m = max(float(np.round(MARK_SIZE * min(apart.min(), extent), 4)), 1e-4)
    sd_mm = of.target_sd_mm or 0.0
    return Scene(
        network=network,
        marks=(
            *(Mark(name, HUES_DEG[k % len(HUES_DEG)], diameter_m) for k, name in enumerate(marks)),
            Mark(TARGET, HUES_DEG[len(marks) % len(HUES_DEG)], diameter_m, measured=False),
        ),
        target=Target(TARGET, 1e-3 * RADIUS_MM, position_sd_m=1e-3 * sd_mm),
        cameras=(),
        reference=Reference(drift_sd_m=0.0),
        mesh=mesh,
    )
