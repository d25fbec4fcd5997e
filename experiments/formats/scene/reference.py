"""Reference marks of a scene file: reading and writing of `[reference]`.

Reference marks do not move in the world. They correct the pose of a camera or tracker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynamics import MassSpringNetwork
from experiments.arrays import Floats
from experiments.errors import no_node, shown
from experiments.formats.scene.marks import Mark, mark_keys
from experiments.formats.scene.network import check_name
from experiments.formats.scene.schema import ReferenceMarkTable, ReferenceTable, SceneError, check_dim, check_own_names
from experiments.formats.toml_file import in_metres, in_millimetres, key_lines
from vision import PlaneCamera


@dataclass(frozen=True, slots=True)
class ReferenceMark:
    """A reference mark, which does not move.

    name: name of the mark in tables, and in the messages of a live tracker
    node: anchor on which the mark lies; None if `position_m` states the position
    position_m: position of the mark [m], (dim,); empty if `node` is stated
    look: appearance of the mark in a film; None if the mark is not filmed
    """

    name: str
    node: str | None = None
    position_m: tuple[float, ...] = ()
    look: Mark | None = None

    def place(self, network: MassSpringNetwork) -> Floats:
        """Position of the mark [m], (dim,)."""
        return np.array(self.position_m) if self.node is None else network.positions[network.index(self.node)].copy()


@dataclass(frozen=True, slots=True)
class Reference:
    """Reference marks of a scene.

    drift_sd_m: standard deviation of an undetected drift of camera or tracker, on each axis [m]; None if not stated
    position_sd_m: standard deviation of the error of each mark's stated position on each axis [m]
    """

    marks: tuple[ReferenceMark, ...] = ()
    drift_sd_m: float | None = None
    position_sd_m: float = 0.0

    @property
    def looks(self) -> tuple[Mark, ...]:
        """Appearances of the filmed reference marks."""
        return tuple(mark.look for mark in self.marks if mark.look is not None)

    def check(
        self, network: MassSpringNetwork, cameras: Sequence[PlaneCamera], marks: Sequence[Mark], *, filmed: bool
    ) -> None:
        """Raise SceneError if the reference marks do not fit the network, the cameras, or the tissue's marks."""
        check_own_names("reference.mark", [mark.name for mark in self.marks])
        for i, mark in enumerate(self.marks):
            key = f"reference.mark[{i}]"
            check_name(f"{key}.name", mark.name)
            if mark.name in network.names and mark.name != mark.node:
                raise SceneError(f"{key}.name: expected its own node's name or a new one, found {shown(mark.name)}")
            self._check_place(key, mark, network)
            if filmed:
                self._check_look(key, mark, marks)
            for j, camera in enumerate(cameras):
                try:
                    camera.project(mark.place(network)[None])
                except ValueError:
                    raise SceneError(f"{key}: expected a place before camera[{j}]'s horizon, found it beyond") from None

    def _check_place(self, key: str, mark: ReferenceMark, network: MassSpringNetwork) -> None:
        if mark.node is None:
            check_dim(f"{key}.position_mm", mark.position_m, network.dim)
        elif mark.node not in network.names:
            raise SceneError(f"{key}.node: {no_node(mark.node, network.names)}")
        elif not network.fixed[network.index(mark.node)]:
            raise SceneError(f"{key}.node: expected an anchor, which is fixed, found the mass {shown(mark.node)}")
        elif not network.is_held:
            raise SceneError(f"{key}.node: expected position_mm on the rig, found {shown(mark.node)}, on a driven wall")

    def _check_look(self, key: str, mark: ReferenceMark, marks: Sequence[Mark]) -> None:
        if mark.look is None:
            raise SceneError(f"{key}: expected hue_deg and diameter_mm, which a camera needs, found none")
        for i, other in enumerate(marks):
            apart = abs((mark.look.hue_deg - other.hue_deg + 180.0) % 360.0 - 180.0)
            if apart < max(mark.look.half_width_deg, other.half_width_deg):
                raise SceneError(
                    f"{key}.hue_deg: expected another hue than the body's marks, found {mark.look.hue_deg:g},"
                    f" {apart:g} degrees from mark[{i}]"
                )


def reference_of(table: ReferenceTable | None) -> Reference:
    """The reference marks of a table; raises SceneError."""
    if table is None:
        return Reference()
    return Reference(tuple(_mark_of(mark) for mark in table.mark), **in_metres(table.model_dump(exclude={"mark"})))


def _mark_of(table: ReferenceMarkTable) -> ReferenceMark:
    look = None
    if table.hue_deg is not None and table.diameter_mm is not None:
        look = Mark(node=table.name, **in_metres(table.model_dump(exclude={"name", "node", "position_mm"})))
    return ReferenceMark(table.name, table.node, tuple(1e-3 * x for x in table.position_mm or ()), look)


def reference_lines(reference: Reference) -> list[str]:
    """Lines of `[reference]`; no lines if the table would be empty."""
    if not reference.marks and reference.drift_sd_m is None:
        return []
    keys = {"drift_sd_m": reference.drift_sd_m, "position_sd_m": reference.position_sd_m or None}
    lines = ["", "[reference]", *key_lines(in_millimetres(keys))]
    for mark in reference.marks:
        place = in_millimetres({"node": mark.node, "position_m": mark.position_m or None})
        look = {} if mark.look is None else mark_keys(mark.look) | {"node": mark.node, "measured": None}
        lines += ["", "[[reference.mark]]", *key_lines({"name": mark.name, **place, **look})]
    return lines


def reference_places(reference: Reference, network: MassSpringNetwork) -> dict[str, Floats]:
    """Position of each reference mark [m], (dim,), by name."""
    return {mark.name: mark.place(network) for mark in reference.marks}
