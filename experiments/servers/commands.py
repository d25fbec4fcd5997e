"""What clients may ask of a running loop, checked before it is handed over: one error in one line, or a command."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

LONGEST_M = 10.0
"""No place in a room is farther from the origin [m]: what a client sends beyond is a mistake; chosen."""

Coordinate = Annotated[float, Field(ge=-1e3 * LONGEST_M, le=1e3 * LONGEST_M)]
Place = Annotated[list[Coordinate], Field(min_length=2, max_length=3)]


class _Command(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class Pause(_Command):
    """Use no frames from now on, nor record them: the target is predicted, without advice; or use them again."""

    command: Literal["pause"]
    on: bool


class Record(_Command):
    """Begin or end a recording."""

    command: Literal["record"]
    on: bool


class Reset(_Command):
    """Forget the state and start anew with the next frame."""

    command: Literal["reset"]


class Fix(_Command):
    """A direct sighting of the target, by ultrasound, say: where [mm] or [px] in the picture, and how sure [mm]."""

    command: Literal["fix"]
    place_mm: Place | None = None
    place_px: Annotated[list[Coordinate], Field(min_length=2, max_length=2)] | None = None
    sd_mm: Annotated[float, Field(gt=0.0, le=1e3)] = 1.0


class Hue(_Command):
    """The colour of a mark is that at this place of the picture [px]."""

    command: Literal["hue"]
    node: Annotated[str, Field(max_length=200)]
    place_px: Annotated[list[Coordinate], Field(min_length=2, max_length=2)]


class NeedleAt(_Command):
    """Where a tracked needle's tip is [mm], and its direction."""

    command: Literal["needle"]
    tip_mm: Place
    direction: Place


UNSEEN = {"command": "needle_unseen"}


class NeedleUnseen(_Command):
    """The needle's tracker does not see it: there is no advice on it until its place is told again."""

    command: Literal["needle_unseen"]


Command = Annotated[Pause | Record | Reset | Fix | Hue | NeedleAt | NeedleUnseen, Field(discriminator="command")]
_ADAPTER: TypeAdapter[Command] = TypeAdapter(Command)


def read_command(found: Any) -> Command:
    """The command of a decoded JSON object, or of its text. ValueError, in one line, where it is none."""
    try:
        return _ADAPTER.validate_json(found) if isinstance(found, str | bytes) else _ADAPTER.validate_python(found)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(one) for one in first["loc"]) or "command"
        raise ValueError(f"{place}: {first['msg']}") from error


def is_needle(found: Any) -> bool:
    """Whether a decoded JSON object, or its text, states a needle, well or not: one that is refused is `UNSEEN`."""
    if isinstance(found, str | bytes):
        try:
            found = json.loads(found)
        except (ValueError, RecursionError):
            return False
    return isinstance(found, dict) and found.get("command") == "needle"
