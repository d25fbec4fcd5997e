"""Scenes: tissue, marks, target and cameras, read from `scene.toml` and written to it."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from dynamics import MassSpringNetwork, NetworkError, ParameterUncertainty, parameter_label
from estimators import FilterSettings
from experiments.arrays import Floats
from experiments.errors import InputError, accepted, no_node, placed, shown
from experiments.formats.camera_yaml import POSE, LensFile
from experiments.formats.outputs import write_together
from experiments.formats.scene.cameras import Camera, camera_lines, camera_of
from experiments.formats.scene.filter import filter_table, settings_of, uncertainty_of
from experiments.formats.scene.marks import Mark, mark_keys
from experiments.formats.scene.mesh import SceneMesh, mesh_lines, mesh_network
from experiments.formats.scene.network import check_name, network_lines, network_of, spring_groups
from experiments.formats.scene.reference import Reference, reference_lines, reference_of, reference_places
from experiments.formats.scene.rest import check_rest
from experiments.formats.scene.schema import (
    CameraTable,
    SceneError,
    SceneFile,
    Step,
    StepName,
    check_dim,
    check_own_names,
)
from experiments.formats.scene.target import Target, target_lines, target_of
from experiments.formats.toml_file import VERSION, in_metres, key_lines, long_list, read_toml
from vision import FilePath, PlaneCamera, SpaceCamera, principal_steps

POSE_REMEDY = "; check --square-mm and --plane of softaim calibrate"
"""End of an error message on the pose of a camera that has a lens."""


LENS_REMEDY = "; check the units: translation_mm in mm, matrix in px"
"""End of an error message on a lens whose model is not one-to-one."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A scene: tissue, marks, target and cameras. Raises SceneError if these parts do not fit together.

    cameras: the cameras of a scene in the plane
    uncertainty: uncertainty of the tissue's constants; None for exact constants
    settings: settings of the filter
    spring_groups: see the function `spring_groups`
    steps: the processing steps that produced this scene, in order
    reference: fixed marks that correct the pose of the camera or tracker
    lenses: cameras with a calibrated lens but no pose; their pictures cannot be used
    mesh: the mesh from which the network was computed; None for a network of springs
    space_cameras: the cameras of a scene in space
    """

    network: MassSpringNetwork
    marks: tuple[Mark, ...]
    target: Target
    cameras: tuple[PlaneCamera, ...]
    uncertainty: ParameterUncertainty | None = None
    settings: FilterSettings = field(default_factory=FilterSettings)
    spring_groups: tuple[str, ...] = ()
    steps: tuple[Step, ...] = ()
    reference: Reference = field(default_factory=Reference)
    lenses: tuple[LensFile, ...] = ()
    mesh: SceneMesh | None = None
    space_cameras: tuple[SpaceCamera, ...] = ()

    def __post_init__(self) -> None:
        for i, name in enumerate(self.network.names):
            check_name(f"network.node[{i}].name", name)
        self._check_marks()
        self._check_led()
        self._check_free("target.node", self.target.node, "a hidden target")
        if self.target.offset_m:
            check_dim("target.offset_mm", self.target.offset_m, self.network.dim)
        self._check_cameras()
        filmed = bool(self.cameras or (self.space_cameras and self.reference.looks))  # else another program sends marks
        self.reference.check(self.network, self.cameras, self.marks, filmed=filmed)

    def _check_cameras(self) -> None:
        check_own_names("camera", [one.name for one in self.cameras] + [one.name for one in self.space_cameras])
        wrong = self.cameras if self.network.dim == 3 else self.space_cameras
        if wrong:
            kinds = ("a flat scene", "a network in space")
            raise SceneError(f"camera: expected {kinds[self.network.dim == 2]}, found {kinds[self.network.dim == 3]}")
        for i, camera in enumerate(self.cameras):
            for name, place in zip(self.network.names, self.network.positions, strict=True):
                try:
                    camera.project(place[None])
                except ValueError:
                    raise SceneError(
                        f"camera[{i}].plane_to_px: expected every node before the camera's horizon,"
                        f" found {shown(name)} beyond{POSE_REMEDY if camera.lens else ''}"
                    ) from None
            middle_px = (np.array(camera.size_px) - 1) / 2
            try:
                camera.to_plane(np.vstack([middle_px, camera.project(self.network.positions)]))
            except ValueError:
                expected = "a lens that shows mid-picture and every node"
                raise SceneError(f"camera[{i}]: expected {expected}, found one that cannot{LENS_REMEDY}") from None

    def _check_marks(self) -> None:
        nodes = [mark.node for mark in self.marks]
        for i, node in enumerate(nodes):
            self._check_free(f"mark[{i}].node", node, "marks belong on free nodes")
            if (first := nodes.index(node)) < i:
                found = f"a second one on {shown(node)}, after mark[{first}]"
                raise SceneError(f"mark[{i}].node: expected one mark for a node, found {found}")
        if not self.measured_nodes:
            raise SceneError("mark: expected one or more measured marks, found none")

    def _check_led(self) -> None:
        of_networks = filter_table(self.settings).keys() & {"led_nodes", "poke_lasting_s"}
        if self.network.continuum is not None and of_networks:
            raise SceneError(f"filter.{min(of_networks)}: expected no such key for a mesh, found one")
        for i, node in enumerate(self.settings.led_nodes):
            key = f"filter.led_nodes[{i}]"
            if node not in self.network.names:
                raise SceneError(f"{key}: {no_node(node, self.network.names)}")
            if node not in self.measured_nodes:
                raise SceneError(f"{key}: expected a node with a measured mark, found {shown(node)} without")

    def _check_free(self, key: str, node: str, why: str) -> None:
        if node not in self.network.names:
            raise SceneError(f"{key}: {no_node(node, self.network.names)}")
        if self.network.fixed[self.network.names.index(node)]:
            raise SceneError(f"{key}: expected a free node ({why}), found the anchor {shown(node)}")

    @property
    def n_cameras(self) -> str:
        """Text for a message: the number of cameras with a pose, and the names of the cameras without one."""
        lacking = "".join(f"; {lens.name} has a lens but no pose: {POSE}" for lens in self.lenses)
        return f"{len(self.cameras) + len(self.space_cameras)}{lacking}"

    @property
    def n_calibration(self) -> int:
        """Number of errors that the filter considers: calibration errors and, with reference marks, pose errors."""
        if self.space_cameras:
            return len(self.calibration_steps[0]) + self.n_pose * len(self.space_cameras)
        return (self.cameras[0].n_calibration if self.cameras else 0) + self.n_pose

    @property
    def n_pose(self) -> int:
        """Number of pose coordinates that are corrected with reference marks; 0 without reference marks."""
        return self.network.dim * (self.network.dim + 1) // 2 if self.reference.marks else 0

    @property
    def calibration_steps(self) -> list[Floats]:
        """Calibration errors of each camera in space: n independent errors of one sd [px, 1, rad, m], (n, 15)."""
        places = reference_places(self.reference, self.network)
        return principal_steps(self.space_cameras, np.vstack([self.network.positions, *places.values()]))

    @property
    def mark_names(self) -> tuple[str, ...]:
        """Names of marks that another tracker may send: nodes with marks, and reference marks."""
        return (*(mark.node for mark in self.marks), *(mark.name for mark in self.reference.marks))

    @property
    def measured_nodes(self) -> tuple[str, ...]:
        """Nodes whose marks the filters may use, in the order of the marks."""
        return tuple(mark.node for mark in self.marks if mark.measured)

    @property
    def nodes_alike(self) -> tuple[tuple[str, ...], ...]:
        """The measured nodes, in groups with marks of the same hue. The marks of one group may be confused."""
        hues = dict.fromkeys(mark.hue_deg for mark in self.marks)
        return tuple(tuple(m.node for m in self.marks if m.measured and m.hue_deg == hue) for hue in hues)


def read_scene(path: FilePath) -> Scene:
    """Read a scene file; raises InputError, `scene.toml: key: expected …, found …`, for the first fault."""
    return scene_of_tables(read_toml(Path(path), SceneFile), Path(path))


def usable_scene(path: Path, *, rests: bool = True) -> Scene:
    """Read a scene file, and require a rest shape near the drawn shape; raises InputError.

    rests: if False, a body without a rest shape is accepted, too
    """
    scene = read_scene(path)
    try:
        check_rest(scene.network)
    except SceneError as error:
        raise InputError(f"{path}: {error}") from None
    except NetworkError as error:
        if rests:
            raise InputError(f"{path}: {error}") from None
    return scene


def scene_of_tables(file: SceneFile, path: Path) -> Scene:
    """The scene that a file's tables describe; raises InputError."""
    with placed(path, SceneError, NetworkError):
        mesh, network = _body(file, path.parent)
        cameras = [_camera(i, camera, path.parent, network.dim) for i, camera in enumerate(file.camera)]
        return Scene(
            network=network,
            marks=tuple(Mark(**in_metres(table.model_dump())) for table in file.mark),
            target=target_of(file.target),
            cameras=tuple(camera for camera in cameras if isinstance(camera, PlaneCamera)),
            lenses=tuple(camera for camera in cameras if isinstance(camera, LensFile)),
            space_cameras=tuple(camera for camera in cameras if isinstance(camera, SpaceCamera)),
            uncertainty=uncertainty_of(file.uncertainty, network),
            settings=settings_of(file.filter),
            spring_groups=() if file.network is None else spring_groups(file.network),
            steps=tuple(file.provenance),
            reference=reference_of(file.reference),
            mesh=mesh,
        )


def _body(file: SceneFile, folder: Path) -> tuple[SceneMesh | None, MassSpringNetwork]:
    """The mesh of a file, if it has one, and the network."""
    if file.network is not None:
        return None, network_of(file.network)
    if file.mesh is None:
        raise SceneError("network: expected this key, or mesh in its place, found none")
    path = folder / file.mesh.file
    with accepted(path, "the file of the scene's mesh"):
        content = path.read_bytes()
    return mesh_network(content, path, file.mesh)


def _camera(i: int, table: CameraTable, folder: Path, dim: int) -> Camera:
    try:
        return camera_of(table, folder, dim)
    except InputError:
        raise
    except ValueError as error:
        raise SceneError(f"camera[{i}].{error}") from None


def write_scene(scene: Scene, path: FilePath) -> None:
    """Write a scene as `scene.toml`, with its mesh beside it, completely or not at all; raises InputError."""
    write_together({**mesh_beside(scene, Path(path)), Path(path): scene_text(scene)})


def mesh_beside(scene: Scene, path: Path, *, force: bool = False) -> dict[Path, bytes]:
    """Path and content of the mesh file that has to be written beside the scene's file; empty if there is none.

    path: the scene's file
    force: if True, the mesh file may replace a different file; if False, a different file causes InputError
    """
    if scene.mesh is None:
        return {}
    file = path.parent / scene.mesh.file
    if force or not file.exists():
        return {file: scene.mesh.content}
    if file.is_file() and file.read_bytes() == scene.mesh.content:
        return {}
    raise InputError.at(file, "no file, or the mesh of this scene", "another")


def scene_text(scene: Scene) -> str:
    """A scene as text of `scene.toml`."""
    return "\n".join([*_content(scene), *step_lines(scene.steps)]) + "\n"


def scene_digest(scene: Scene) -> str:
    """SHA-256 of a scene's content, without its list of processing steps."""
    return digest(_content(scene))


def network_digest(scene: Scene) -> str:
    """SHA-256 of the scene's network, or of its mesh if it has one; other parts of the scene have no effect."""
    return digest(_body_lines(scene))


def with_step(
    scene: Scene, step: StepName, program: str, recording: str | None = None, kept: Sequence[str] = ()
) -> Scene:
    """The scene with one more step at the end of its list; the other arguments become fields of this `Step`."""
    done = Step(
        step=step,
        program=program,
        recording_sha256=recording,
        network_sha256=network_digest(scene),
        scene_sha256=scene_digest(scene),
        kept=list(kept),
    )
    return replace(scene, steps=(*scene.steps, done))


def digest(lines: Sequence[str]) -> str:
    """SHA-256 of lines of a scene file, with numbers rounded to twelve digits."""
    text = re.sub(r"(?<![\w.])-?\d+\.\d+(?:e[-+]?\d+)?", lambda found: f"{float(found[0]):.12g}", "\n".join(lines))
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def step_lines(steps: Sequence[Step]) -> list[str]:
    """Lines of `[[provenance]]`, one table for each step. They have no date, so that equal steps give equal lines."""
    lines = []
    for step in steps:
        lines += ["", "[[provenance]]", *key_lines(step.model_dump(exclude={"kept"}))]
        if step.kept:
            lines += long_list("kept", step.kept, why="not determined by the recording: unchanged")
    return lines


def _body_lines(scene: Scene) -> list[str]:
    if scene.mesh is not None:
        return mesh_lines(scene.mesh, scene.network)
    return network_lines(scene.network, scene.spring_groups)


def _content(scene: Scene) -> list[str]:
    network = scene.network
    lines = [f"version = {VERSION}", "", *_body_lines(scene)]
    for mark in scene.marks:
        lines += ["", "[[mark]]", *key_lines(mark_keys(mark))]
    lines += target_lines(scene.target)
    lines += reference_lines(scene.reference)
    if scene.uncertainty is not None:
        names = [parameter_label(network, one) for one in scene.uncertainty.parameters]
        lines += ["", "[uncertainty]", *long_list("parameters", names)]
        lines += long_list("directions", scene.uncertainty.directions)
    if keys := filter_table(scene.settings):
        lines += ["", "[filter]", *key_lines(keys)]
    cameras: tuple[Camera, ...] = (*scene.cameras, *scene.space_cameras, *scene.lenses)
    for camera in cameras:
        lines += camera_lines(camera)
    return lines
