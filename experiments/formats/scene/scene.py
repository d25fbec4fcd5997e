"""Scenes: what is in view, read from `scene.toml` and written to it."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dynamics import MassSpringNetwork, NetworkError, ParameterUncertainty
from estimators import FilterSettings
from experiments.arrays import Floats
from experiments.errors import InputError, shown
from experiments.formats.outputs import write_whole
from experiments.formats.scene.cameras import camera_lines, camera_of
from experiments.formats.scene.filter import filter_table, settings_of, uncertainty_names, uncertainty_of
from experiments.formats.scene.schema import (
    VERSION,
    CameraTable,
    MarkTable,
    NetworkTable,
    NodeTable,
    SceneFile,
    read_toml,
)
from vision import MarkHue, PlaneCamera


class SceneError(ValueError):
    """Parts of a scene that do not fit together; the message is `key: expected …, found …`, keys as in scene.toml."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A coloured spot on a node: its hue [degrees], its diameter [m]; not measured means seen for scoring only.

    half_width_deg, min_saturation, min_value: what counts as its colour, as `MarkHue` has it
    even: of one colour, unlike a ball with its shading
    """

    node: str
    hue_deg: float
    diameter_m: float
    measured: bool = True
    half_width_deg: float = 18.0
    min_saturation: float = 0.4
    min_value: float = 0.2
    even: bool = True

    @property
    def hue(self) -> MarkHue:
        """What colours count as this mark's."""
        return MarkHue(self.hue_deg, self.half_width_deg, self.min_saturation, self.min_value)


@dataclass(frozen=True, slots=True)
class Target:
    """The hidden node that the needle is for, and the radius that counts as a hit [m]."""

    node: str
    radius_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What is in view: tissue, marks on its free nodes, the target and the cameras; SceneError if they do not fit.

    uncertainty: how well the constants of the tissue are known, None where they are taken as exact
    settings: what the filter is to assume of noise and pokes
    """

    network: MassSpringNetwork
    marks: tuple[Mark, ...]
    target: Target
    cameras: tuple[PlaneCamera, ...]
    uncertainty: ParameterUncertainty | None = None
    settings: FilterSettings = field(default_factory=FilterSettings)

    def __post_init__(self) -> None:
        for i, name in enumerate(self.network.names):
            if not name or not name.isprintable() or name != name.strip():
                raise SceneError(
                    f"network.node[{i}].name: expected a name that prints on one line, found {shown(name)}"
                )
        self._check_marks()
        self._check_free("target.node", self.target.node, "a hidden target")
        seen: dict[str, int] = {}
        for i, camera in enumerate(self.cameras):
            if camera.name in seen:
                raise SceneError(
                    f"camera[{i}].name: expected a name of its own, found that of camera[{seen[camera.name]}]"
                )
            seen[camera.name] = i
            if self.network.dim != 2:
                raise SceneError(f"camera[{i}].plane_to_px: expected a flat scene, found a network in space")
            for mark in self.marks:
                try:
                    camera.project(self.network.positions[self.network.index(mark.node)][None])
                except ValueError:
                    raise SceneError(
                        f"camera[{i}].plane_to_px: expected every mark before the camera's horizon,"
                        f" found that of {shown(mark.node)} beyond"
                    ) from None

    def _check_marks(self) -> None:
        seen: dict[str, int] = {}
        for i, mark in enumerate(self.marks):
            self._check_free(f"mark[{i}].node", mark.node, "a mark tells of a free node")
            if mark.node in seen:
                raise SceneError(
                    f"mark[{i}].node: expected one mark for a node, found a second one on {shown(mark.node)},"
                    f" after mark[{seen[mark.node]}]"
                )
            seen[mark.node] = i
        if not self.measured_nodes:
            raise SceneError("mark: expected one or more measured marks, found none")

    def _check_free(self, key: str, node: str, why: str) -> None:
        if node not in self.network.names:
            raise SceneError(f"{key}: no node named {shown(node)}")
        if self.network.fixed[self.network.names.index(node)]:
            raise SceneError(f"{key}: expected a free node ({why}), found the anchor {shown(node)}")

    @property
    def n_calibration(self) -> int:
        """In how many directions the calibration of the camera that is looked through may be off."""
        return len(self.cameras[0].calibration) if self.cameras else 0

    @property
    def measured_nodes(self) -> tuple[str, ...]:
        """Nodes whose marks the filters may use, in the order of the marks."""
        return tuple(mark.node for mark in self.marks if mark.measured)

    @property
    def nodes_alike(self) -> tuple[tuple[str, ...], ...]:
        """The measured nodes by the hue of their marks: those of one group might be taken for each other."""
        hues = dict.fromkeys(mark.hue_deg for mark in self.marks)
        return tuple(tuple(m.node for m in self.marks if m.measured and m.hue_deg == hue) for hue in hues)


def read_scene(path: Path) -> Scene:
    """The scene of a file; raises InputError, `scene.toml: key: expected …, found …`, for the first fault."""
    file = read_toml(path, SceneFile)
    try:
        network = _network(file.network)
        return Scene(
            network=network,
            marks=tuple(_mark(m) for m in file.mark),
            target=Target(file.target.node, 1e-3 * file.target.radius_mm),
            cameras=tuple(_camera(i, camera, path.parent) for i, camera in enumerate(file.camera)),
            uncertainty=uncertainty_of(file.uncertainty, network),
            settings=settings_of(file.filter),
        )
    except (SceneError, NetworkError) as error:
        raise InputError(f"{path}: {error}") from None


def _mark(table: MarkTable) -> Mark:
    return Mark(
        table.node,
        table.hue_deg,
        1e-3 * table.diameter_mm,
        table.measured,
        table.half_width_deg,
        table.min_saturation,
        table.min_value,
        table.even,
    )


def _network(table: NetworkTable) -> MassSpringNetwork:
    indices: dict[str, int] = {}
    for i, node in enumerate(table.node):
        _check_node(table, i, node)
        if node.name in indices:
            raise SceneError(
                f"network.node[{i}].name: expected a name of its own,"
                f" found {shown(node.name)}, that of network.node[{indices[node.name]}]"
            )
        indices[node.name] = i
    if all(node.fixed for node in table.node):
        raise SceneError("network.node: expected one or more free nodes, found none")
    springs = [_ends(table, s, indices) for s in range(len(table.spring))]
    attached = {i for ends in springs for i in ends}
    for i, node in enumerate(table.node):
        if not node.fixed and i not in attached:
            raise SceneError(f"network.node[{i}]: expected one or more springs to {shown(node.name)}, found none")
    try:
        return MassSpringNetwork(
            names=tuple(indices),
            positions=1e-3 * np.array([node.position_mm for node in table.node]),
            masses=np.array([node.mass_kg or 0.0 for node in table.node]),
            fixed=np.array([node.fixed for node in table.node]),
            drag=np.array([node.drag_N_s_m for node in table.node]),
            friction=np.array([node.friction_N for node in table.node]),
            springs=np.array(springs, dtype=np.int64),
            stiffness=np.array([spring.stiffness_N_m for spring in table.spring]),
            rest_lengths=1e-3 * np.array([spring.rest_length_mm for spring in table.spring]),
            damping=np.array([spring.damping_N_s_m for spring in table.spring]),
            gravity=np.array(table.gravity_m_s2),
        )
    except NetworkError as error:
        raise SceneError(f"network: {error}") from None


def _check_node(table: NetworkTable, i: int, node: NodeTable) -> None:
    if node.mass_kg is None and not node.fixed:
        raise SceneError(f"network.node[{i}].mass_kg: expected this key for a free node, found none")
    if node.mass_kg is not None and (node.mass_kg < 0 or (node.mass_kg == 0 and not node.fixed)):
        expected = "0 or more" if node.fixed else "more than 0"
        raise SceneError(f"network.node[{i}].mass_kg: expected {expected}, found {shown(node.mass_kg)}")
    dim = len(table.gravity_m_s2)
    if len(node.position_mm) != dim:
        raise SceneError(
            f"network.node[{i}].position_mm: expected {dim} numbers, as network.gravity_m_s2 has,"
            f" found {len(node.position_mm)}"
        )


def _ends(table: NetworkTable, s: int, indices: dict[str, int]) -> tuple[int, int]:
    key, between = f"network.spring[{s}].between", table.spring[s].between
    for name in between:
        if name not in indices:
            raise SceneError(f"{key}: no node named {shown(name)}")
    i, j = (indices[name] for name in between)
    if i == j:
        raise SceneError(f"{key}: expected two different nodes, found {shown(between)}")
    if table.node[i].position_mm == table.node[j].position_mm:
        raise SceneError(
            f"{key}: expected nodes at different places, found both at {shown(table.node[i].position_mm)} mm"
        )
    return i, j


def _camera(i: int, table: CameraTable, folder: Path) -> PlaneCamera:
    try:
        return camera_of(table, folder)
    except InputError:
        raise
    except ValueError as error:
        raise SceneError(f"camera[{i}].{error}") from None


def write_scene(scene: Scene, path: Path) -> None:
    """Write a scene as `scene.toml`, whole or not at all; raises InputError."""
    network = scene.network
    lines = [f"version = {VERSION}", "", "[network]", f"gravity_m_s2 = {_list(network.gravity)}"]
    for i, name in enumerate(network.names):
        lines += ["", "[[network.node]]", f"name = {_text(name)}"]
        # to 1e-12 m, so that what computed rest shapes leave of a zero is a zero; adding 0.0 takes its sign away
        lines += [f"position_mm = {_list(np.round(1e3 * network.positions[i], 9) + 0.0)}"]
        if not network.fixed[i] or network.masses[i] > 0:
            lines += [f"mass_kg = {_number(network.masses[i])}"]
        lines += [f"drag_N_s_m = {_number(network.drag[i])}", f"friction_N = {_number(network.friction[i])}"]
        lines += [f"fixed = {_bool(network.fixed[i])}"]
    for s, (i, j) in enumerate(network.springs):
        lines += ["", "[[network.spring]]", f"between = [{_text(network.names[i])}, {_text(network.names[j])}]"]
        lines += [f"stiffness_N_m = {_number(network.stiffness[s])}"]
        lines += [f"rest_length_mm = {_number(1e3 * network.rest_lengths[s])}"]
        lines += [f"damping_N_s_m = {_number(network.damping[s])}"]
    for mark in scene.marks:
        lines += ["", "[[mark]]", f"node = {_text(mark.node)}", f"hue_deg = {_number(mark.hue_deg)}"]
        lines += [f"diameter_mm = {_number(1e3 * mark.diameter_m)}", f"measured = {_bool(mark.measured)}"]
        lines += [f"half_width_deg = {_number(mark.half_width_deg)}"]
        lines += [f"min_saturation = {_number(mark.min_saturation)}", f"min_value = {_number(mark.min_value)}"]
        lines += [f"even = {_bool(mark.even)}"]
    lines += ["", "[target]", f"node = {_text(scene.target.node)}"]
    lines += [f"radius_mm = {_number(1e3 * scene.target.radius_m)}"]
    if scene.uncertainty is not None:
        names = uncertainty_names(network, scene.uncertainty)
        lines += ["", "[uncertainty]", "parameters = [", *(f"    {_text(name)}," for name in names), "]"]
        lines += ["directions = [", *(f"    {_list(row)}," for row in scene.uncertainty.directions), "]"]
    if keys := filter_table(scene.settings):
        lines += ["", "[filter]"]
        lines += [f"{key} = {_bool(v) if isinstance(v, bool) else _number(v)}" for key, v in keys.items()]
    for camera in scene.cameras:
        lines += camera_lines(camera)
    write_whole(path, "\n".join(lines) + "\n")


def _number(value: float) -> str:
    # 15 digits: 178.9 and not 178.90000000000001, and no more than 1e-15 away
    text = f"{value:.15g}"
    return text if set(text) & set(".e") else f"{text}.0"


def _list(values: Floats) -> str:
    return f"[{', '.join(_number(value) for value in values)}]"


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)


def _bool(value: bool) -> str:
    return "true" if value else "false"
