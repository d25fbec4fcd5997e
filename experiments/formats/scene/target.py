"""The target of a scene file: read from `[target]`, and written to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators import TargetPoint
from experiments.formats.scene.schema import TargetTable
from experiments.formats.toml_file import key_lines


@dataclass(frozen=True, slots=True)
class Target:
    """The hidden target point: a node, or a point at an offset from it.

    radius_m: radius of a hit [m]; offset_m: offset from the node [m], (dim,), whose direction is constant; empty: none
    position_sd_m: standard deviation of its position in the tissue on each axis, including registration [m]; None: not
    stated
    """

    node: str
    radius_m: float
    offset_m: tuple[float, ...] = ()
    position_sd_m: float | None = None

    @property
    def point(self) -> TargetPoint:
        """The target for estimators. If its accuracy is not stated it is exact here; advice adds a default error."""
        return TargetPoint((self.node,), offset_m=self.offset_m, sd_m=self.position_sd_m or 0.0)


def target_of(table: TargetTable) -> Target:
    """The target of a table."""
    sd_mm = table.position_sd_mm
    return Target(
        table.node,
        1e-3 * table.radius_mm,
        tuple(1e-3 * x for x in table.offset_mm or ()),
        None if sd_mm is None else 1e-3 * sd_mm,
    )


def target_lines(target: Target) -> list[str]:
    """The lines of `[target]`, without an offset of zero."""
    keys = {
        "node": target.node,
        "radius_mm": 1e3 * target.radius_m,
        "offset_mm": 1e3 * np.array(target.offset_m) if target.offset_m else None,
        "position_sd_mm": None if target.position_sd_m is None else 1e3 * target.position_sd_m,
    }
    return ["", "[target]", *key_lines(keys)]
