"""Commands of clients to a running loop; an invalid command raises an error whose message is one line."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

LONGEST_M = 10.0
"""Largest absolute value of a coordinate from a client [m]; choice: larger values are errors."""

Coordinate = Annotated[float, Field(ge=-1e3 * LONGEST_M, le=1e3 * LONGEST_M)]
Place = Annotated[list[Coordinate], Field(min_length=2, max_length=3)]


class _Command(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class Pause(_Command):
    """Pause or resume the use and recording of frames. A pause stops the advice, but not the target's prediction."""

    command: Literal["pause"]
    on: bool


class Record(_Command):
    """Begin or end a recording."""

    command: Literal["record"]
    on: bool


class Reset(_Command):
    """Reset the filter; the next frame initialises it again."""

    command: Literal["reset"]


class Fix(_Command):
    """A direct measurement of the target, such as by ultrasound: its position [mm] or [px], and its sd [mm]."""

    command: Literal["fix"]
    place_mm: Place | None = None
    place_px: Annotated[list[Coordinate], Field(min_length=2, max_length=2)] | None = None
    sd_mm: Annotated[float, Field(gt=0.0, le=1e3)] = 1.0


class Hue(_Command):
    """Set the colour of a mark to the colour of the picture at a position [px]."""

    command: Literal["hue"]
    node: Annotated[str, Field(max_length=200)]
    place_px: Annotated[list[Coordinate], Field(min_length=2, max_length=2)]


class NeedleAt(_Command):
    """Set the position of a tracked needle's tip [mm], and the direction of the needle."""

    command: Literal["needle"]
    tip_mm: Place
    direction: Place


UNSEEN = {"command": "needle_unseen"}


class NeedleUnseen(_Command):
    """Record that the tracker does not see the needle: there is no advice until the needle's position is sent again."""

    command: Literal["needle_unseen"]


Command = Annotated[Pause | Record | Reset | Fix | Hue | NeedleAt | NeedleUnseen, Field(discriminator="command")]
_ADAPTER: TypeAdapter[Command] = TypeAdapter(Command)


def read_command(found: Any) -> Command:
    """Read a command from a JSON object, decoded or as text; raises ValueError with a message of one line."""
    try:
        return _ADAPTER.validate_json(found) if isinstance(found, str | bytes) else _ADAPTER.validate_python(found)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(one) for one in first["loc"]) or "command"
        raise ValueError(f"{place}: {first['msg']}") from error


def is_needle(found: Any) -> bool:
    """Whether a JSON object, decoded or as text, is a needle command, valid or not."""
    if isinstance(found, str | bytes):
        try:
            found = json.loads(found)
        except (ValueError, RecursionError):
            return False
    return isinstance(found, dict) and found.get("command") == "needle"
