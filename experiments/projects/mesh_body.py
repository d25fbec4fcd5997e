"""Project with a body of tetrahedra: mesh, tissues, wall, marks and target from the options of `softaim new`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from dynamics.mesh import MeshError, TetMesh, far_apart, locate, locate_on_surface
from experiments.arrays import Floats
from experiments.errors import InputError, coordinates, placed, shown
from experiments.formats.mesh.body import Body, read_body
from experiments.formats.mesh.project_file import (
    PLANE,
    REGION,
    WALL,
    ProjectMesh,
    beyond,
    extents,
    held,
    mesh_content,
)
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.mesh import coinciding, mesh_network, mesh_table
from experiments.formats.scene.network import is_node_name
from experiments.formats.scene.reference import Reference
from experiments.formats.scene.scene import Scene
from experiments.formats.scene.schema import MeshTable, SceneError
from experiments.formats.scene.target import Target
from experiments.formats.tables import Table, read_table
from experiments.log import LOG
from experiments.plain import amount
from experiments.projects.mesh_tissues import assigned, check_tissues
from experiments.projects.needle import surest_entry
from experiments.projects.template import (
    GROUP_SD,
    HUES_DEG,
    MARK_SIZE,
    RADIUS_MM,
    Template,
)

FILE = "mesh.npz"
"""File name of the mesh in a project's folder."""

N_MARKS = 40
"""Default number of marks of a project."""

FEW, MANY = 10, 80
"""Least and largest number of marks without a warning; choice: in a breast of 968 nodes the target's sd is 2.1 mm with
6 marks and 0.3 mm with 10. An estimate takes 40 ms with 80 marks; more marks would be too slow."""

WALL_FORMS = '"y < 6" [mm], "faces 2" or "region 1"'
"""Forms of `--fixed`, for messages."""

TARGET = "T"

NEAR = 0.05
"""Largest distance by which a mark is moved onto the surface, relative to the body's extent; choice: 5 mm in 100 mm."""

LEAST_FREE = 1e-3
"""Least sum of the free nodes' interpolation weights at a target that can move [1]; numerical."""

N_DRAWS = 100
"""Largest number of random positions that are tried until the simulated lesion is inside the body; choice."""

FINEST = 7
"""Number of decimals of positions in metres in a new project: positions are rounded to 0.1 µm."""

SHALLOWEST_MM = 0.01
"""Least depth of a target below the surface [mm]: on the surface, the direction from target to skin is not defined."""


@dataclass(frozen=True, slots=True)
class MeshChoice:
    """The options of `softaim new` for a body of tetrahedra.

    marks: number of marks, or a file with columns name,x_mm,y_mm,z_mm; target_mm: position of the target, as x,y,z
    regions: tissue of each label, as LABEL=TISSUE; driven: whether the filter expects that the wall moves
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
    driven: bool = True


def mesh_template(of: MeshChoice, *, young_pa: float | None, seed: int) -> Template:
    """The project with a body of tetrahedra; raises InputError.

    young_pa: Young's modulus [Pa] for a body of one tissue
    """
    _check_words(of, young_pa)
    size_m = None if of.size_mm is None else 1e-3 * of.size_mm
    body = read_body(of.path, of.unit, size_m, lambda places, given: _check_fits(of, places, given))
    tissues, regions = assigned(body, of.path, of.field, of.regions, young_pa)
    mesh = replace(body.mesh, regions=regions)
    wall, fixed = _wall(ProjectMesh(mesh, np.empty(0, dtype=np.int64)), body, of, [one.name for one in tissues])
    kept = ProjectMesh(mesh, wall)
    anchored = held(kept, fixed)
    faces = _free_faces(body, anchored)
    marks = {name: np.round(place, FINEST) for name, place in _marks(of.marks, mesh, faces).items()}
    target = np.round(_target(of, mesh, anchored), FINEST)
    corner, weights, _ = locate_on_surface(mesh, faces, target[None])
    nearest = np.einsum("kc,kcd->d", weights, mesh.nodes[faces[corner]])
    if np.linalg.norm(nearest - target) < 1e-3 * SHALLOWEST_MM:
        raise InputError.at("--target", "a point inside", f"{np.round(1e3 * target, 3)} mm on the surface")
    points = [*marks.items(), (TARGET, target)]
    content = mesh_content(kept)
    table = partial(mesh_table, FILE, fixed)
    assumed = _scene(content, of, table(dict(enumerate(tissues)), points, driven=of.driven), marks)
    rng = np.random.default_rng(seed)
    actual = [
        replace(
            one,
            young_pa=one.young_pa * float(np.exp(rng.normal(0.0, GROUP_SD["stiffness"]))),
            damping_s=one.damping_s * float(np.exp(rng.normal(0.0, GROUP_SD["damping"]))),
        )
        for one in tissues
    ]
    points = [*marks.items(), (TARGET, np.round(_drawn(of, target, mesh, anchored, rng), FINEST))]
    exactly = replace(of, target_sd_mm=0.0)  # the lesion's position is already random; `insert` must not vary it again
    truth = _scene(content, exactly, table(dict(enumerate(actual)), points, driven=False), marks)
    entry, direction = surest_entry(assumed.network, TARGET, mesh, faces, nearest, anchored)
    counts = (
        f"{len(mesh.nodes)} nodes, {len(anchored)} of them fixed, "
        f"{len(mesh.elements)} tetrahedra, {amount(1e6 * mesh.volumes.sum(), 'ml', 'l')}, {extents(mesh.nodes)},"
    )
    return Template(f"A body of {counts} from {of.path.name}", assumed, truth, entry, direction)


def _check_words(of: MeshChoice, young_pa: float | None) -> None:
    """Before the body is read, raise InputError for invalid options; warn of too few or too many marks."""
    check_tissues(of.field, of.regions, young_pa)
    fixed = (of.fixed or "").strip()
    if of.fixed is not None and not (PLANE.fullmatch(fixed) or REGION.fullmatch(fixed) or _label_of(fixed)):
        raise InputError.at("--fixed", WALL_FORMS, shown(of.fixed))
    if of.target_mm is not None:
        _place(of.target_mm)
    if not of.marks.isdecimal():
        n_marks = len(_table(Path(of.marks)).texts["name"])
    elif not (n_marks := int(of.marks)):
        raise InputError.at("--marks", "1 or more, or a file of marks", of.marks)
    if n_marks < FEW:
        LOG.warning("--marks: expected %d or more, found %d: the target is poorly determined", FEW, n_marks)
    if n_marks > MANY:
        LOG.warning("--marks: with more than %d, found %d, an estimate takes longer than a frame", MANY, n_marks)


def _check_fits(of: MeshChoice, places: Floats, body: Body | None) -> None:
    """Raise InputError for options that do not fit a body whose nodes have these positions [m], (n, 3).

    body: the body in the file; None if the file has only a surface, whose elements are made later
    """
    if of.fixed is None:
        raise InputError.at("--fixed", f"the fixed nodes, {WALL_FORMS}", f"none; {extents(places)}")
    plane = PLANE.fullmatch(of.fixed.strip())
    if plane and not len(beyond(places, plane)):
        raise InputError.at("--fixed", "a part of the body", f"none; {extents(places)}")
    if of.target_mm is not None:
        target = _place(of.target_mm)
        if ((target < places.min(axis=0)) | (target > places.max(axis=0))).any():
            raise _outside(of, places)
    if body is not None:
        assigned(body, of.path, of.field, of.regions, None)
        _labelled(body, of.fixed)
        return
    labels = {"--field": of.field, "--region": of.regions, "--fixed": _label_of(of.fixed)}
    for option, given in labels.items():
        if given:
            raise InputError.at(option, f"tetrahedra with labels in {of.path.name}", "a surface")


def _outside(of: MeshChoice, places: Floats) -> InputError:
    """The error for a target outside of a body with positions [m], (n, 3)."""
    found = f"{of.target_mm}, which is outside; {extents(places)}"
    return InputError.at("--target", f"a place inside {of.path.name}", found)


def _label_of(fixed: str) -> str:
    """The text after "faces" in the value of `--fixed`: LABEL or FIELD=LABEL; empty for a value without "faces"."""
    what, _, label = fixed.strip().partition(" ")
    return label.strip() if what == "faces" else ""


def _labelled(body: Body, fixed: str) -> NDArray[np.int64] | None:
    """Nodes of the faces with the label that `fixed` states; None without a label; InputError for a wrong label."""
    if not (named := _label_of(fixed)):
        return None
    chosen, _, label = named.rpartition("=")
    fields = {name: {f"{v:g}" for v in values if np.isfinite(v)} for name, values in body.faces.fields.items()}
    found = [name for name, labels in fields.items() if label in labels and chosen in ("", name)]
    if not found:
        has = ", ".join(sorted(set().union(*fields.values()))) or "none"
        raise InputError.at("--fixed", "a label of faces in the file", f"{shown(named)}; it has {has}")
    if len(found) > 1:
        choice = " or ".join(f'"faces {name}={label}"' for name in found)
        raise InputError.at("--fixed", f"one field with label {label}, {choice}", shown(fixed))
    return np.unique(body.faces.nodes[body.faces.fields[found[0]] == float(label)])


def _wall(of: ProjectMesh, body: Body, choice: MeshChoice, tissues: Sequence[str]) -> tuple[NDArray[np.int64], str]:
    """The fixed nodes, and the text for the scene's key `fixed`; raises InputError if none or all nodes are fixed.

    tissues: names, by region
    """
    nodes, fixed = of.wall, (choice.fixed or "").strip()
    region = REGION.fullmatch(fixed)
    if region and int(region[1]) not in range(len(tissues)):
        has = ", ".join(f"{k} ({name})" for k, name in enumerate(tissues))
        raise InputError.at("--fixed", f"a region, {has}", shown(fixed))
    if (labelled := _labelled(body, fixed)) is not None:
        nodes, fixed = labelled, WALL
    with placed("--fixed", ValueError):
        held(ProjectMesh(of.mesh, nodes), fixed)
    return nodes, fixed


def _free_faces(body: Body, fixed: NDArray[np.int64]) -> NDArray[np.int64]:
    """Outer faces without a fixed corner, (k, 3); raises InputError if there are none."""
    is_held = np.zeros(len(body.mesh.nodes), dtype=bool)
    is_held[fixed] = True
    faces = body.faces.nodes[~is_held[body.faces.nodes].any(axis=1)]
    if not len(faces):
        raise InputError.at("--fixed", "a free surface for marks", "none")
    return faces


def _marks(marks: str, mesh: TetMesh, faces: NDArray[np.int64]) -> dict[str, Floats]:
    """Names and positions of marks on the free surface [m]; raises InputError."""
    if not marks.isdecimal():
        return _listed(Path(marks), mesh, faces)
    nodes, count = np.unique(faces), int(marks)
    if count > len(nodes):
        raise InputError.at("--marks", f"1 to {len(nodes)}, the nodes of the free surface, or a file of marks", marks)
    places = mesh.nodes[nodes]
    outermost = int(np.linalg.norm(places - places.mean(axis=0), axis=1).argmax())
    chosen = far_apart(places, count, [outermost])
    return {f"M{k}": places[i] for k, i in enumerate(chosen, start=1)}


def _table(path: Path) -> Table:
    """The table in a file of marks, with checked names; raises InputError."""
    table = read_table(path, ["x_mm", "y_mm", "z_mm"], ["name"])
    names = table.texts["name"]
    table.check("name", np.array([is_node_name(name) and name != TARGET for name in names]), "a name for a mark")
    table.check("name", np.array([names.index(name) == i for i, name in enumerate(names)]), "a unique name")
    if not names:
        raise InputError.at(path, "a row for each mark", "none")
    return table


def _listed(path: Path, mesh: TetMesh, faces: NDArray[np.int64]) -> dict[str, Floats]:
    """The marks of a file, moved onto the free surface."""
    table = _table(path)
    given = 1e-3 * np.stack([table.numbers[axis] for axis in ("x_mm", "y_mm", "z_mm")], axis=1)
    corner, weights, away = locate_on_surface(mesh, faces, given)
    most = NEAR * float(np.ptp(mesh.nodes, axis=0).max())
    if away.max() > most:
        row = int(away.argmax())
        raise InputError.at(
            table.place(row, "x_mm"),
            f"a place within {1e3 * most:.3g} mm of the free surface",
            f"{1e3 * away[row]:.3g} mm",
        )
    places = np.einsum("kc,kcd->kd", weights, mesh.nodes[faces[corner]])
    is_first = ~np.isin(np.arange(len(places)), coinciding(places)[:, 1])
    table.check("x_mm", is_first, "a place on the surface that no other mark has")
    return dict(zip(table.texts["name"], places, strict=True))


def _place(text: str) -> Floats:
    """The position [m], (3,), that `--target` states; raises InputError."""
    return 1e-3 * np.array(coordinates("--target", text, 3, "x,y,z [mm]"))


def _target(of: MeshChoice, mesh: TetMesh, anchored: NDArray[np.int64]) -> Floats:
    """The target's position [m], (3,); by default the centre of the element nearest to the body's centre.

    anchored: fixed nodes; raises InputError if they hold the target
    """
    if of.target_mm is None:
        centres = mesh.nodes[mesh.elements].mean(axis=1)
        middle = np.average(centres, axis=0, weights=mesh.volumes)
        place = np.asarray(centres[np.linalg.norm(centres - middle, axis=1).argmin()])
    else:
        place = _place(of.target_mm)
    try:
        weight = _free_weight(place, mesh, anchored)
    except MeshError:
        raise _outside(of, mesh.nodes) from None
    if weight < LEAST_FREE:
        found = f"{','.join(f'{x:.4g}' for x in 1e3 * place)}, which --fixed {of.fixed} fixes"
        raise InputError.at("--target", "a position that can move", found)
    return place


def _drawn(
    of: MeshChoice, target: Floats, mesh: TetMesh, anchored: NDArray[np.int64], rng: np.random.Generator
) -> Floats:
    """Random position of the simulated lesion [m], (3,), in tissue that can move; its sd is `target_sd_mm`."""
    sd_m = 1e-3 * (of.target_sd_mm or 0.0)
    for place in target + sd_m * rng.normal(size=(N_DRAWS, 3)) if sd_m else target[None]:
        with suppress(MeshError):
            if _free_weight(place, mesh, anchored) >= LEAST_FREE:
                return np.asarray(place)
    raise InputError.at("--target-sd-mm", "an SD that leaves the target inside the body", shown(of.target_sd_mm))


def _free_weight(place: Floats, mesh: TetMesh, anchored: NDArray[np.int64]) -> float:
    """Sum of the weights by which free nodes interpolate a position [m], (3,). Raises MeshError outside the body."""
    element, weights = locate(mesh, place[None])
    return float(weights[~np.isin(mesh.elements[element], anchored)].sum())


def _scene(content: bytes, of: MeshChoice, table: MeshTable, marks: dict[str, Floats]) -> Scene:
    """The scene of a mesh, with marks on its surface, and a mark on the target that the filter does not use."""
    with placed(of.path, SceneError):
        mesh, network = mesh_network(content, of.path, table)
    places = np.array([*marks.values()])
    apart_m = pdist(places).min() if len(places) > 1 else 0.06
    diameter_m = max(float(np.round(MARK_SIZE * apart_m, 4)), 1e-4)
    return Scene(
        network=network,
        marks=(
            *(Mark(name, HUES_DEG[k % len(HUES_DEG)], diameter_m) for k, name in enumerate(marks)),
            Mark(TARGET, HUES_DEG[len(marks) % len(HUES_DEG)], diameter_m, measured=False),
        ),
        target=Target(TARGET, 1e-3 * RADIUS_MM, position_sd_m=1e-3 * (of.target_sd_mm or 0.0)),
        cameras=(),
        reference=Reference(drift_sd_m=0.0),
        mesh=mesh,
    )
