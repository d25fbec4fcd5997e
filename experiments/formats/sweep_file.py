"""Sweep files for `softaim sweep`: a scenario, a tissue, methods, seeds and a grid of parameters."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, create_model

from dynamics import KINDS
from experiments.errors import InputError, shown
from experiments.formats.scenario import Scenario, SeenMarks, read_scenario_file, scenario_file, shipped
from experiments.formats.scene.schema import FilterTable
from experiments.formats.toml_file import Name, Positive, Strict, read_toml, validated

MOST_RUNS = 1_000_000
"""Largest number of runs in a sweep: more are probably a typing error."""

MOTION = ("duration_s", "frame_interval_s", "tremor", "release", "pokes", "breathing", "posture", "press", "constants")
"""Keys of a scenario that a grid may vary. A sweep sets the seeds itself, and makes no films."""


ModelFactors = create_model(  # type: ignore[call-overload]
    "ModelFactors", __base__=Strict, **dict.fromkeys(KINDS, (Positive, 1.0))
)
"""Factors on the constants that the methods use, for each kind of constant. The true constants do not change."""


GROUPS: Mapping[str, type[Strict]] = {
    "scenario": Scenario,
    "filter": FilterTable,
    "marks": SeenMarks,
    "model": ModelFactors,
}
"""Tables that a grid can vary. Each key of the grid begins with one of these names."""


class SweepFile(Strict):
    """A sweep file, version 1."""

    version: Literal[1]
    scenario: Name
    scene: Name | None = None
    methods: list[Name] = Field(default=["filter"])
    seeds: Annotated[int, Field(ge=1)] = 20
    first_seed: Annotated[int, Field(ge=0)] = 0
    grid: dict[str, Any] = Field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Setup:
    """One combination of values from a grid.

    at: value of each key of the grid
    scenario, filter, marks, model: checked tables with these values
    """

    at: Mapping[str, Any]
    scenario: Scenario
    filter: FilterTable
    marks: SeenMarks
    model: Strict


@dataclass(frozen=True, slots=True)
class Sweep:
    """A checked sweep.

    methods: names of the methods as in the file, not checked
    scenario: file of the scenario; None for a scenario that comes with the program
    scene: scene file of the tissue; None for the phantom
    setups: combinations of values in the order of the grid
    """

    path: Path
    methods: tuple[str, ...]
    seeds: range
    scenario: Path | None
    scene: Path | None
    setups: tuple[Setup, ...]

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of the grid."""
        return tuple(self.setups[0].at)


def read_sweep(path: Path) -> Sweep:
    """Read a sweep file; raises InputError, `file: key: expected …, found …`, for the first fault."""
    file = read_toml(path, SweepFile)
    name = file.scenario if file.scenario in shipped() else str(path.parent / file.scenario)
    if file.scenario not in shipped() and not Path(name).is_file():
        raise InputError.at(f"{path}: scenario", f"one of {', '.join(shipped())} or a file", shown(file.scenario))
    read = read_scenario_file(name)
    lists = dict(_lists(file.grid, f"{path}: grid", ()))
    n_runs = file.seeds * math.prod(len(values) for values in lists.values())
    if n_runs > MOST_RUNS:
        raise InputError.at(f"{path}: grid", f"at most {MOST_RUNS} runs", str(n_runs))
    starts: dict[str, dict[str, Any]] = {
        "scenario": read.model_dump(exclude_unset=True),
        "marks": read.seen.model_dump(),
    }
    setups = []
    for values in itertools.product(*lists.values()):
        at = dict(zip(lists, values, strict=True))
        parts: dict[str, Any] = {}
        for group, model in GROUPS.items():
            changed = _changed(starts.get(group, {}), {key: value for key, value in at.items() if key[0] == group})
            parts[group] = validated(changed, model, f"{path}: grid.{group}.")
        setups.append(Setup({".".join(key): value for key, value in at.items()}, **parts))
    own = None if read.scene is None else Path(read.scene)
    scene = own if file.scene is None else path.parent / file.scene
    seeds = range(file.first_seed, file.first_seed + file.seeds)
    return Sweep(path, tuple(file.methods), seeds, scenario_file(name), scene, tuple(setups))


def _lists(table: Mapping[str, Any], place: str, above: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], list[Any]]]:
    """Key and values of each parameter of a grid. Raises InputError for keys and values that a grid cannot have."""
    for name, value in table.items():
        key, here = (*above, name), f"{place}.{name}"
        if not above and name not in GROUPS:
            raise InputError.at(here, f"one of {', '.join(GROUPS)}", "an unknown key")
        if above == ("scenario",) and name not in MOTION:
            raise InputError.at(here, f"one of {', '.join(MOTION)}", "a key that a grid cannot vary")
        if isinstance(value, dict):
            yield from _lists(value, here, key)
        elif not isinstance(value, list) or not value:
            raise InputError.at(here, "a list of one or more values", shown(value))
        else:
            yield key, value


def _changed(start: Mapping[str, Any], at: Mapping[tuple[str, ...], Any]) -> dict[str, Any]:
    """A copy of a table in which the keys of `at` have new values. The first part of each key is the table's name."""
    table = dict(start)
    for key, value in at.items():
        inner = table
        for part in key[1:-1]:
            inner[part] = dict(inner.get(part) or {})
            inner = inner[part]
        inner[key[-1]] = value
    return table
