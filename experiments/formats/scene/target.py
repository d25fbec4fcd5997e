"""The target of a scene file: read from `[target]`, and written to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators import TargetPoint
from experiments.formats.scene.schema import TargetTable
from experiments.formats.toml_file import toml_list, toml_number, toml_text


@dataclass(frozen=True, slots=True)
class Target:
    """The hidden point that the needle is for: a node, or a place at an offset from it.

    radius_m: that counts as a hit [m]; offset_m: from the node, fixed in direction [m], (dim,); empty: the node itself
    """

    node: str
    radius_m: float
    offset_m: tuple[float, ...] = ()

    @property
    def point(self) -> TargetPoint:
        """The target as every estimator takes it."""
        return TargetPoint((self.node,), offset_m=self.offset_m)


def target_of(table: TargetTable) -> Target:
    """The target of a table."""
    return Target(table.node, 1e-3 * table.radius_mm, tuple(1e-3 * x for x in table.offset_mm or ()))


def target_lines(target: Target) -> list[str]:
    """The lines of `[target]`; no offset where there is none."""
    lines = ["", "[target]", f"node = {toml_text(target.node)}", f"radius_mm = {toml_number(1e3 * target.radius_m)}"]
    return lines + ([f"offset_mm = {toml_list(1e3 * np.array(target.offset_m))}"] if target.offset_m else [])
