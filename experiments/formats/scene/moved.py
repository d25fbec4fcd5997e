"""Rigid motion of a scene: the body moves in the world, the cameras do not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from dynamics import MassSpringNetwork
from estimators import RigidMotion
from experiments.errors import shown
from experiments.formats.mesh.project_file import WALL, ProjectMesh, held, mesh_content, mesh_of
from experiments.formats.scene.mesh import APART_M, SceneMesh, mesh_network
from experiments.formats.scene.reference import Reference
from experiments.formats.scene.scene import Scene
from experiments.formats.scene.schema import MeshPointTable, SceneError


def moved_scene(scene: Scene, motion: RigidMotion, mesh_file: Path) -> Scene:
    """The scene with moved body, gravity, target and reference marks. `mesh_file` is the file of the moved mesh.

    Gravity turns with the body, so that the body's rest shape does not change.
    Raises SceneError if the moved scene is not valid, for example if a mark is beyond a camera's horizon.
    """
    mesh, drawn = None, scene.network
    if scene.mesh is not None:
        mesh, network = _moved_mesh(scene.mesh, drawn, motion, mesh_file)
    else:
        network = replace(drawn, positions=motion.moved(drawn.positions), gravity=motion.rotation @ drawn.gravity)
    offset = motion.rotation @ scene.target.offset_m if scene.target.offset_m else ()
    return replace(
        scene,
        network=network,
        mesh=mesh,
        target=replace(scene.target, offset_m=tuple(map(float, offset))),
        reference=_moved_reference(scene, motion, network),
    )


def _moved_mesh(
    mesh: SceneMesh, network: MassSpringNetwork, motion: RigidMotion, file: Path
) -> tuple[SceneMesh, MassSpringNetwork]:
    """The moved mesh and its network. Its file lists the fixed nodes, because a plane in `fixed` cannot be moved."""
    of = mesh_of(mesh.content, Path(mesh.file))
    wall = of.wall if mesh.fixed is None else held(of, mesh.fixed)
    content = mesh_content(ProjectMesh(replace(of.mesh, nodes=motion.moved(of.mesh.nodes)), wall))
    places_mm = np.round(1e3 * motion.moved(np.array([place for _, place in mesh.points])), 9) + 0.0
    points = [
        MeshPointTable(name=name, position_mm=place)
        for (name, _), place in zip(mesh.points, places_mm.tolist(), strict=True)
    ]
    table = mesh.table(network).model_copy(
        update={"file": file.name, "fixed": None if mesh.fixed is None else WALL, "point": points}
    )
    return mesh_network(content, file, table)


def _moved_reference(scene: Scene, motion: RigidMotion, network: MassSpringNetwork) -> Reference:
    marks = []
    for i, mark in enumerate(scene.reference.marks):
        place = motion.moved(mark.place(scene.network)[None])[0]
        if mark.node is None:
            marks.append(replace(mark, position_m=tuple(place.tolist())))
            continue
        marks.append(mark)
        if np.linalg.norm(mark.place(network) - place) > APART_M:  # it may be another node of the moved wall
            expected = "position_mm for an anchor whose name changes as the mesh moves"
            raise SceneError(f"reference.mark[{i}]: expected {expected}, found {shown(mark.node)}")
    return replace(scene.reference, marks=tuple(marks))
