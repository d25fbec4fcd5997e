"""Reading of TOML files, with a check against a model that reports the first fault; writing of TOML values."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from experiments.errors import InputError, read_text, shown
from experiments.log import LOG

Number = Callable[[float], str]
"""Function that formats a number."""

VERSION = 1
"""Version of the formats: scene, scenario, needle, plan and camera files."""


class Strict(BaseModel):
    """Base class of TOML tables. Unknown keys, numbers in quotes, booleans for numbers and NaN are faults."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        # unknown keys are reported first, since a misspelt key also looks like a missing one
        for key in data if isinstance(data, dict) else ():
            if key not in cls.model_fields:
                raise PydanticCustomError("unknown_key", "{keys}", {"key": key, "keys": ", ".join(cls.model_fields)})
        return data


Model = TypeVar("Model", bound=Strict)
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Coordinates = Annotated[list[float], Field(min_length=2, max_length=3)]
Name = Annotated[str, Field(min_length=1)]
Three = Annotated[list[float], Field(min_length=3, max_length=3)]
Square = Annotated[list[Three], Field(min_length=3, max_length=3)]
Row = Annotated[list[float], Field(min_length=15, max_length=15)]


def read_toml(path: Path, model: type[Model]) -> Model:
    """Read a TOML file and check it against a model; raises InputError for the first fault, with file and key."""
    text = read_text(path)
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise InputError.at(path, "TOML", "lists nested too deeply") from None
    except ValueError as error:  # TOMLDecodeError, or an integer too long for Python
        raise _not_toml(path, text, str(error)) from None
    # checked first, since keys of other versions are unknown
    version = data.get("version")
    if type(version) is not int or version != VERSION:
        raise InputError.at(f"{path}: version", str(VERSION), "none" if version is None else shown(version))
    read = validated(data, model, f"{path}: ")
    LOG.info("read %s", path)
    return read


def check_axes(place: str, vector: Sequence[float], dim: int) -> None:
    """Raise InputError if a position or direction has another dimension than the scene."""
    if len(vector) != dim:
        raise InputError.at(place, f"{dim} numbers, as the scene has", str(len(vector)))


def validated(data: dict[str, Any], model: type[Model], place: str) -> Model:
    """A table, checked against a model. Raises InputError for the first fault; its message begins with `place`."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{place}{_reported(error.errors(include_url=False)[0])}") from None


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
    """The path of a value in a TOML file, such as `network.spring[3].between`. List entries are counted from 0."""
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
"""Text on the expected value in a message, by pydantic's type of error."""


def _reported(error: ErrorDetails) -> str:
    kind, context, loc = error["type"], error.get("ctx", {}), error["loc"]
    if kind == "unknown_key":
        return f"{key_path((*loc, context['key']))}: expected one of {context['keys']}, found an unknown key"
    if kind == "value_error":  # raised by a model's own check, already in this form
        return f"{key_path(loc)}: {context['error']}".removeprefix(": ")
    expected = EXPECTED[kind].format(**context) if kind in EXPECTED else error["msg"]
    if kind == "missing":
        found = "none"
    elif kind in ("too_short", "too_long"):
        found = str(context["actual_length"])
    else:
        found = shown(error["input"])
    return f"{key_path(loc)}: expected {expected}, found {found}"


def in_metres(table: Mapping[str, Any]) -> dict[str, Any]:
    """A table with lengths in metres: each key that ends in _mm, such as `radius_mm`, becomes `radius_m`."""
    return _scaled(table, "_mm", "_m", 1e-3)


def in_millimetres(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Fields with lengths in millimetres: each name that ends in _m, such as `radius_m`, becomes `radius_mm`."""
    return _scaled(fields, "_m", "_mm", 1e3)


def _scaled(values: Mapping[str, Any], old: str, new: str, factor: float) -> dict[str, Any]:
    """Fields in another unit: the ending `old` of names is replaced by `new`, and values are multiplied by `factor`."""
    scaled: dict[str, Any] = {}
    for key, value in values.items():
        if not key.endswith(old):
            scaled[key] = value
        elif value is None or isinstance(value, float | int):
            scaled[key.removesuffix(old) + new] = value and factor * value
        else:
            scaled[key.removesuffix(old) + new] = tuple(factor * x for x in value)
    return scaled


def toml_number(value: float) -> str:
    """A number with at most 15 digits, for example 178.9 for 178.90000000000001."""
    text = f"{value:.15g}"
    return text if set(text) & set(".e") else f"{text}.0"


def toml_text(value: str) -> str:
    """A text as TOML, in quotes."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def toml_value(value: Any, number: Number = toml_number) -> str:
    """A boolean, a number, a text, or a list of these, as TOML on one line."""
    if isinstance(value, bool | np.bool_):
        return "true" if value else "false"
    if isinstance(value, str):
        return toml_text(value)
    if isinstance(value, int | np.integer):
        return str(value)
    if isinstance(value, float | np.floating):
        return number(float(value))
    return f"[{', '.join(toml_value(one, number) for one in value)}]"


def long_list(key: str, entries: Iterable[Any], number: Number = toml_number, why: str = "") -> list[str]:
    """Lines of a list, one for each entry. `why` is a comment on the first line."""
    return [f"{key} = [{why and f'  # {why}'}", *(f"    {toml_value(entry, number)}," for entry in entries), "]"]


def key_lines(table: Mapping[str, Any], number: Number = toml_number) -> list[str]:
    """The lines of a table, one for each key. Keys whose value is None are omitted; a matrix has a line per row."""
    lines: list[str] = []
    for key, value in table.items():
        if isinstance(value, np.ndarray) and value.ndim == 2:
            lines += long_list(key, value, number)
        elif value is not None:
            lines += [f"{key} = {toml_value(value, number)}"]
    return lines


def exactly(value: float) -> str:
    """A number with all its digits."""
    return repr(float(value))
