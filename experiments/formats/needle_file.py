"""Needle files, `needle.toml`: the needle, its path, the lesion, the needle's forces, and thresholds of the advice."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from dynamics import MassSpringNetwork
from estimators import AdviceSettings, Hit, Insertion, Lesion, Needle, NeedlePush, PlannedNeedle
from estimators.process.target import TargetPoint
from experiments.errors import InputError, shown
from experiments.formats.marks.rows import FARTHEST_MM, FINEST_MM, Coordinate
from experiments.formats.toml_file import NotNegative, Positive, Strict, check_axes, in_metres, read_toml

Part = Annotated[float, Field(ge=0, le=1)]
Length = Annotated[float, Field(ge=0, le=FARTHEST_MM)]
Size = Annotated[float, Field(ge=FINEST_MM, le=FARTHEST_MM)]
Place = Annotated[list[Coordinate], Field(min_length=2, max_length=3)]
USUAL, SETTINGS = Needle(), AdviceSettings()


class NeedleForces(Strict):
    """`[forces]`: constants of `dynamics.NeedleMechanics` that the filter assumes; the defaults are for soft PVC.

    error: largest relative deviation of a true constant from the assumed constant
    If puncture_N is 0, the skin has no resistance.
    """

    puncture_N: NotNegative = 0.8  # noqa: N815 (the format's own word)
    contact_N_m: Positive = 400.0  # noqa: N815
    cutting_N: NotNegative = 0.4  # noqa: N815
    friction_N_m: NotNegative = 5.0  # noqa: N815
    error: Annotated[float, Field(ge=0, lt=1)] = 0.3

    def planned(self, network: MassSpringNetwork) -> PlannedNeedle:
        """The needle for estimators. The relative error of its force is uniformly distributed from -error to error."""
        return PlannedNeedle(
            cutting_N=self.cutting_N,
            friction_N_m=self.friction_N_m,
            reach_m=force_reach_m(network),
            force_sd=self.error / 3.0**0.5,
        )

    def constants(self) -> dict[str, float]:
        """The constants of `dynamics.NeedleMechanics` by name."""
        return self.model_dump(exclude={"error"})


FORCES = NeedleForces()


def force_reach_m(network: MassSpringNetwork) -> float:
    """Width [m] of the kernel that distributes a needle's force over the nodes; choice: 0.3 of a spring's length."""
    lengths = network.rest_lengths
    if not len(lengths):  # points of a continuum: the distance to the nearest point replaces a spring's length
        places = network.positions
        lengths = np.sort(np.linalg.norm(places[:, None] - places, axis=2), axis=1)[:, 1]
    return 0.3 * float(np.median(lengths))


class LesionTable(Strict):
    """`[lesion]`: a ball, given by its radius, or an ellipsoid, given by its semi-axes as vectors."""

    radius_mm: Size | None = None
    semi_axes_mm: Annotated[list[Place], Field(min_length=2, max_length=3)] | None = None

    @model_validator(mode="after")
    def _one_form(self) -> LesionTable:
        if (self.radius_mm is None) == (self.semi_axes_mm is None):
            found = "none" if self.radius_mm is None else "both"
            raise ValueError(f"expected either radius_mm or semi_axes_mm, found {found}")
        return self


class AdviceTable(Strict):
    """`[advice]`: thresholds of the advice, see `AdviceSettings`."""

    go: Annotated[float, Field(gt=0, le=1)] = SETTINGS.go
    worth: Part = SETTINGS.worth
    horizon_s: Annotated[float, Field(ge=0, le=60)] = SETTINGS.horizon_s
    step_s: Annotated[float, Field(ge=0.001)] = SETTINGS.step_s
    stale_s: Positive = SETTINGS.stale_s
    coasting_s: NotNegative = SETTINGS.coasting_s
    needle_s: Positive = SETTINGS.needle_s
    overshot_mm: NotNegative = 1e3 * SETTINGS.overshot_m
    abort: Part = SETTINGS.abort
    abort_s: NotNegative = SETTINGS.abort_s


class NeedleFile(Strict):
    """The content of `needle.toml`, version 1."""

    version: int
    entry_mm: Place
    direction: Place
    speed_mm_s: Annotated[float, Field(ge=0.01, le=FARTHEST_MM)]
    depth_mm: Length = 0.0
    hit: Literal["TIP", "NOTCH", "CORE"] = USUAL.hit.value
    notch_offset_mm: Length = 1e3 * USUAL.notch_offset_m
    notch_length_mm: Size = 1e3 * USUAL.notch_length_m
    core_mm: Size = 1e3 * USUAL.core_m
    tip_sd_mm: Length = 1e3 * USUAL.tip_sd_m
    bending_sd_mm_per_mm: NotNegative = USUAL.bending_sd
    lesion: LesionTable | None = None
    forces: NeedleForces = FORCES
    advice: AdviceTable = AdviceTable()

    @model_validator(mode="after")
    def _fits(self) -> NeedleFile:
        if self.hit == "CORE" and self.core_mm > self.notch_length_mm:
            raise ValueError(
                f"core_mm: expected no more than notch_length_mm ({self.notch_length_mm:g}), found {self.core_mm:g}"
            )
        if np.linalg.norm(self.direction) < FINEST_MM:
            raise ValueError(f"direction: expected a non-zero vector, found {shown(self.direction)}")
        return self


@dataclass(frozen=True, slots=True, eq=False)
class NeedlePlan:
    """Content of a needle file in SI units."""

    needle: Needle
    insertion: Insertion
    lesion: Lesion
    settings: AdviceSettings
    forces: NeedleForces = FORCES

    def push_on(self, network: MassSpringNetwork, target: TargetPoint) -> NeedlePush:
        """The model of the target's displacement by the force of this needle."""
        return NeedlePush(network, target, self.forces.planned(network))


def read_needle(path: Path, radius_m: float, dim: int) -> NeedlePlan:
    """Read a needle file for a scene of this dimension; raises InputError.

    radius_m: radius of the lesion [m], used if the file does not state it
    """
    file = read_toml(path, NeedleFile)
    for key in ("entry_mm", "direction"):
        check_axes(f"{path}: {key}", getattr(file, key), dim)
    lengths = in_metres(file.model_dump(include={"notch_offset_mm", "notch_length_mm", "core_mm", "tip_sd_mm"}))
    needle = Needle(Hit(file.hit), bending_sd=file.bending_sd_mm_per_mm, **lengths)
    insertion = Insertion(
        1e-3 * np.array(file.entry_mm), np.array(file.direction), 1e-3 * file.speed_mm_s, 1e-3 * file.depth_mm
    )
    settings = AdviceSettings(**in_metres(file.advice.model_dump()))
    return NeedlePlan(needle, insertion, _lesion(path, file.lesion, radius_m, dim), settings, file.forces)


def _lesion(path: Path, table: LesionTable | None, radius_m: float, dim: int) -> Lesion:
    if table is None or table.semi_axes_mm is None:
        radius = radius_m if table is None or table.radius_mm is None else 1e-3 * table.radius_mm
        return Lesion.ball(radius, dim)
    rows = table.semi_axes_mm
    place, expected = f"{path}: lesion.semi_axes_mm", f"{dim} vectors of {dim} numbers, none in the span of the others"
    if len(rows) != dim or any(len(row) != dim for row in rows):
        raise InputError.at(place, expected, shown(rows))
    try:
        return Lesion(1e-3 * np.array(rows).T)
    except ValueError:
        raise InputError.at(place, expected, shown(rows)) from None
