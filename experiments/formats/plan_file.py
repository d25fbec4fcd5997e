"""Plan files, `plan.toml`: the needle, its permitted entries, and obstacles; lengths in mm."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from dynamics import GAUGES_MM
from estimators import Obstacle, PlannedNeedle, Skin
from experiments.errors import InputError
from experiments.formats.toml_file import (
    Coordinates,
    Name,
    NotNegative,
    Positive,
    Strict,
    check_axes,
    in_metres,
    read_toml,
)

Kind = Literal["rib", "vessel", "other"]


class NeedleTable(Strict):
    """`[needle]`: the needle's gauge, its forces and its errors, see `PlannedNeedle`."""

    gauge: int = 16
    cutting_N: NotNegative = PlannedNeedle().cutting_N  # noqa: N815 (the format's own word)
    friction_N_m: NotNegative = PlannedNeedle().friction_N_m  # noqa: N815
    reach_mm: Positive = 1e3 * PlannedNeedle().reach_m
    force_sd: NotNegative = PlannedNeedle().force_sd
    tip_sd_mm: Positive = 1e3 * PlannedNeedle().tip_sd_m

    @model_validator(mode="after")
    def _known(self) -> NeedleTable:
        if self.gauge not in GAUGES_MM:
            raise ValueError(f"gauge: expected one of {', '.join(map(str, GAUGES_MM))}, found {self.gauge}")
        return self


class EntryTable(Strict):
    """`[entry]`: permitted entries on a segment (in the plane) or in a box (in space). About `n` of them are tried."""

    from_mm: Coordinates
    to_mm: Coordinates
    normal: Coordinates
    max_angle_deg: Annotated[float, Field(gt=0, le=90)] = 60.0
    max_length_mm: Positive = 150.0
    n: Annotated[int, Field(ge=1, le=10_000)] = 100
    n_aims: Annotated[int, Field(ge=1, le=99)] = 5

    @model_validator(mode="after")
    def _usable(self) -> EntryTable:
        if not any(self.normal):
            raise ValueError("normal: expected a direction out of the tissue, found zeros")
        if self.n_aims % 2 == 0:
            raise ValueError(f"n_aims: expected an odd number, found {self.n_aims}")
        return self


class ObstacleTable(Strict):
    """`[[obstacle]]`: a ball, given by its centre, or a capsule, given by the ends of its axis."""

    name: Name
    kind: Kind = "other"
    centre_mm: Coordinates | None = None
    from_mm: Coordinates | None = None
    to_mm: Coordinates | None = None
    radius_mm: Positive
    margin_mm: NotNegative = 0.0

    @model_validator(mode="after")
    def _one_form(self) -> ObstacleTable:
        given = [key for key in ("centre_mm", "from_mm", "to_mm") if getattr(self, key) is not None]
        if given not in (["centre_mm"], ["from_mm", "to_mm"]):
            raise ValueError(f"expected centre_mm, or from_mm and to_mm, found {', '.join(given) or 'none of them'}")
        return self


class PlanFile(Strict):
    """The content of `plan.toml`, version 1.

    arrival_s: time from the last frame of a recording to the needle's arrival
    target_sd_mm: standard deviation of the target on each axis, used without a recording
    """

    version: int
    arrival_s: NotNegative = 0.0
    target_sd_mm: Positive = 2.0
    needle: NeedleTable = NeedleTable()
    entry: EntryTable
    obstacle: list[ObstacleTable] = Field(default_factory=list)


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Content of a plan file in SI units.

    kinds: the kind of each obstacle
    arrival_s, target_sd_m: as in `PlanFile`
    n_entries: number of entries to try; n_aims: number of points to aim at for each entry
    """

    needle: PlannedNeedle
    skin: Skin
    obstacles: tuple[Obstacle, ...]
    kinds: tuple[Kind, ...]
    arrival_s: float
    target_sd_m: float
    n_entries: int
    n_aims: int


def read_task(path: Path, dim: int) -> Task:
    """Read a plan file for a scene of this dimension; raises InputError, `file: key: expected …, found …`."""
    file = read_toml(path, PlanFile)
    places = {f"entry.{key}": getattr(file.entry, key) for key in ("from_mm", "to_mm", "normal")}
    names = [one.name for one in file.obstacle]
    for i, one in enumerate(file.obstacle):
        places |= {f"obstacle[{i}].{key}": getattr(one, key) for key in ("centre_mm", "from_mm", "to_mm")}
        if (first := names.index(one.name)) < i:
            raise InputError.at(f"{path}: obstacle[{i}].name", "a unique name", f"that of obstacle[{first}]")
    for key, place in places.items():
        if place is not None:
            check_axes(f"{path}: {key}", place, dim)
    table, entry = file.needle, file.entry
    return Task(
        needle=PlannedNeedle(
            radius_m=0.5e-3 * GAUGES_MM[table.gauge], **in_metres(table.model_dump(exclude={"gauge"}))
        ),
        skin=Skin(
            1e-3 * np.array(entry.from_mm),
            1e-3 * np.array(entry.to_mm),
            np.array(entry.normal),
            float(np.radians(entry.max_angle_deg)),
            1e-3 * entry.max_length_mm,
        ),
        obstacles=tuple(_obstacle(one) for one in file.obstacle),
        kinds=tuple(one.kind for one in file.obstacle),
        arrival_s=file.arrival_s,
        target_sd_m=1e-3 * file.target_sd_mm,
        n_entries=entry.n,
        n_aims=entry.n_aims,
    )


def _obstacle(table: ObstacleTable) -> Obstacle:
    start = table.from_mm if table.centre_mm is None else table.centre_mm
    end = table.to_mm if table.centre_mm is None else table.centre_mm
    ends = (1e-3 * np.array(start), 1e-3 * np.array(end))
    return Obstacle(table.name, *ends, 1e-3 * table.radius_mm, 1e-3 * table.margin_mm)
