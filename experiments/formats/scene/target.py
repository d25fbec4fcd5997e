"""The target of a scene file: reading and writing of `[target]`."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from estimators import TargetPoint
from experiments.formats.scene.schema import TargetTable
from experiments.formats.toml_file import in_metres, in_millimetres, key_lines


@dataclass(frozen=True, slots=True)
class Target:
    """The hidden target point: a node, or a point at an offset from it.

    radius_m: largest distance between needle and target for a hit [m]
    offset_m: constant offset from the node [m]; empty if zero
    position_sd_m: standard deviation of the target's position on each axis [m], including the registration error
    """

    node: str
    radius_m: float
    offset_m: tuple[float, ...] = ()
    position_sd_m: float | None = None

    @property
    def point(self) -> TargetPoint:
        """The target for estimators. If position_sd_m is not stated, it is 0 here; advice uses a default."""
        return TargetPoint((self.node,), offset_m=self.offset_m, sd_m=self.position_sd_m or 0.0)


def target_of(table: TargetTable) -> Target:
    """The target of a table."""
    return Target(**in_metres(table.model_dump() | {"offset_mm": table.offset_mm or ()}))


def target_lines(target: Target) -> list[str]:
    """The lines of `[target]`; an offset of zero is omitted."""
    keys = in_millimetres(asdict(target) | {"offset_m": target.offset_m or None})
    return ["", "[target]", *key_lines(keys)]
