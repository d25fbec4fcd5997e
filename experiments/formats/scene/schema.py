"""TOML files checked against a model: the words of `scene.toml`, and how a fault in any such file is told."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from dynamics import KINDS
from experiments.errors import InputError, read_text, shown

VERSION = 1
"""Of the formats that are read: scene and scenario files."""


class Strict(BaseModel):
    """A table of a TOML file: no unknown keys, no numbers in quotes, no booleans for numbers, no NaN."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        # before all else: a misspelt key should be told as such, not as the key that it leaves missing
        for key in data if isinstance(data, dict) else ():
            if key not in cls.model_fields:
                raise PydanticCustomError("unknown_key", "{keys}", {"key": key, "keys": ", ".join(cls.model_fields)})
        return data


Model = TypeVar("Model", bound=Strict)
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Coordinates = Annotated[list[float], Field(min_length=2, max_length=3)]
Name = Annotated[str, Field(min_length=1)]


class NodeTable(Strict):
    """`[[network.node]]`; an anchor may leave out its mass."""

    name: Name
    position_mm: Coordinates
    mass_kg: float | None = None
    drag_N_s_m: NotNegative = 0.0  # noqa: N815 (the format's own word)
    friction_N: NotNegative = 0.0  # noqa: N815
    fixed: bool = False


class SpringTable(Strict):
    """`[[network.spring]]`."""

    between: Annotated[list[Name], Field(min_length=2, max_length=2)]
    stiffness_N_m: Positive  # noqa: N815
    rest_length_mm: Positive
    damping_N_s_m: NotNegative = 0.0  # noqa: N815


class NetworkTable(Strict):
    """`[network]`."""

    gravity_m_s2: Coordinates
    node: list[NodeTable]
    spring: list[SpringTable]


class MarkTable(Strict):
    """`[[mark]]`."""

    node: Name
    hue_deg: Annotated[float, Field(ge=0, lt=360)]
    diameter_mm: Positive
    measured: bool = True
    half_width_deg: Annotated[float, Field(ge=2, le=90)] = 18.0
    min_saturation: Annotated[float, Field(gt=0, lt=1)] = 0.4
    min_value: Annotated[float, Field(gt=0, lt=1)] = 0.2
    even: bool = True


class TargetTable(Strict):
    """`[target]`."""

    node: Name
    radius_mm: Positive


Three = Annotated[list[float], Field(min_length=3, max_length=3)]
Square = Annotated[list[Three], Field(min_length=3, max_length=3)]
Row = Annotated[list[float], Field(min_length=15, max_length=15)]


class CameraTable(Strict):
    """`[[camera]]` before a flat scene: a homography, or a lens and where it stands, or the file that tells both."""

    name: Name | None = None
    size_px: Annotated[list[Annotated[int, Field(gt=0)]], Field(min_length=2, max_length=2)] | None = None
    plane_to_px: Square | None = None
    matrix: Square | None = None
    distortion: Annotated[list[float], Field(min_length=5, max_length=5)] | None = None
    rotation: Square | None = None
    translation_mm: Three | None = None
    uncertainty: list[Row] | None = None
    file: Name | None = None
    calibration_sd_px: NotNegative = 0.0

    @model_validator(mode="after")
    def _one_form(self) -> CameraTable:
        forms = {
            "plane_to_px": ("name", "size_px", "plane_to_px"),
            "matrix": ("name", "size_px", "matrix", "distortion", "rotation", "translation_mm"),
            "file": ("file",),
        }
        given = [key for key in forms if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(f"expected one of {', '.join(forms)}, found {' and '.join(given) or 'none'}")
        needed = forms[given[0]]
        allowed = {*needed, "uncertainty"} if given[0] == "matrix" else set(needed)
        for key in type(self).model_fields:
            if key in needed and getattr(self, key) is None:
                raise ValueError(f"{key}: expected this key beside {given[0]}, found none")
            if key not in allowed and key != "calibration_sd_px" and getattr(self, key) is not None:
                raise ValueError(f"{key}: expected no such key beside {given[0]}, found one")
        return self


class UncertaintyTable(Strict):
    """`[uncertainty]`: how well the constants are known, relative standard deviations.

    Either by kind, every constant of it by itself, or as directions: each row one standard deviation along one
    direction, independent of the others, of the logs of the parameters named.
    """

    stiffness: Positive | None = None
    rest_length: Positive | None = None
    damping: Positive | None = None
    drag: Positive | None = None
    friction: Positive | None = None
    parameters: list[Name] | None = None
    directions: list[list[float]] | None = None

    @model_validator(mode="after")
    def _one_form(self) -> UncertaintyTable:
        kinds = [kind for kind in KINDS if getattr(self, kind) is not None]
        if (self.parameters is None) != (self.directions is None):
            raise ValueError("expected parameters and directions together, found one of them")
        if self.parameters is not None and kinds:
            raise ValueError(f"expected parameters and directions or kinds, found both, {kinds[0]}")
        if self.parameters is None and not kinds:
            raise ValueError(f"expected one or more of {', '.join(KINDS)}, or parameters and directions, found none")
        for row in self.directions or ():
            if len(row) != len(self.parameters or ()):
                raise ValueError(f"expected directions of {len(self.parameters or ())} numbers each, found {len(row)}")
        return self


class FilterTable(Strict):
    """`[filter]`: noise levels for this tissue and camera in place of the usual ones, see `FilterSettings`."""

    white_m_s2_sqrt_hz: Positive | None = None
    poke_m_s2: Positive | None = None
    poke_lasting_s: Positive | None = None
    fix_bias_mm: Positive | None = None
    adapt_marks: bool = False


class SceneFile(Strict):
    """The whole of `scene.toml`, version 1."""

    version: int
    network: NetworkTable
    uncertainty: UncertaintyTable | None = None
    filter: FilterTable | None = None
    mark: list[MarkTable] = []
    target: TargetTable
    camera: list[CameraTable] = []


def read_toml(path: Path, model: type[Model]) -> Model:
    """The TOML file as the model has it; raises InputError, `file: key: expected …, found …`, for the first fault."""
    text = read_text(path)
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise InputError.at(path, "TOML", "lists nested too deeply") from None
    except ValueError as error:  # TOMLDecodeError, or an integer too long for Python
        raise _not_toml(path, text, str(error)) from None
    # first: what another version's keys would be is not for this reader to say
    version = data.get("version")
    if type(version) is not int or version != VERSION:
        raise InputError.at(f"{path}: version", str(VERSION), "none" if version is None else shown(version))
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{path}: {_reported(error.errors(include_url=False)[0])}") from None


def _not_toml(path: Path, text: str, message: str) -> InputError:
    place = re.search(r" \(at (?:line (\d+), column (\d+)|end of document)\)$", message)
    if place is None:
        return InputError.at(path, "TOML", shown(message)[1:-1])
    what = message[: place.start()]
    what = shown(what[0].lower() + what[1:])[1:-1].replace('\\"', '"')
    if place[1] is None:
        return InputError.at(f"{path}: line {len(text.splitlines())}", "TOML", f"{what} at the end")
    return InputError.at(f"{path}: line {place[1]}", "TOML", f"{what} at column {place[2]}")


def key_path(loc: Sequence[int | str]) -> str:
    """The place of a value in a TOML file, list entries counted from 0: `network.spring[3].between`."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc).removeprefix(".")


EXPECTED = {
    "missing": "this key",
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "text in quotes",
    "string_too_short": "a name",
    "bool_type": "true or false",
    "list_type": "a list",
    "model_type": "a table",
    "finite_number": "a finite number",
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "less_than": "less than {lt:g}",
    "less_than_equal": "{le:g} or less",
    "too_short": "{min_length} or more entries",
    "too_long": "{max_length} entries or fewer",
    "literal_error": "{expected}",
}
"""What to say was expected, by pydantic's type of error."""


def _reported(error: ErrorDetails) -> str:
    kind, context, loc = error["type"], error.get("ctx", {}), error["loc"]
    if kind == "unknown_key":
        return f"{key_path((*loc, context['key']))}: expected one of {context['keys']}, found an unknown key"
    if kind == "value_error":  # a check of a model's own, already in these words
        return f"{key_path(loc)}: {context['error']}".removeprefix(": ")
    expected = EXPECTED[kind].format(**context) if kind in EXPECTED else error["msg"]
    if kind == "missing":
        found = "none"
    elif kind in ("too_short", "too_long"):
        found = str(context["actual_length"])
    else:
        found = shown(error["input"])
    return f"{key_path(loc)}: expected {expected}, found {found}"
