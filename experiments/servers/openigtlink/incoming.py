"""What a client sends, as commands to the loop: a tracked needle's TRANSFORM, and sightings of the target as POINT."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from experiments.arrays import Floats
from experiments.servers.commands import UNSEEN, read_command
from experiments.servers.openigtlink.bodies import PointBody, read_points, read_transform
from experiments.servers.openigtlink.codec import Message
from experiments.servers.openigtlink.outgoing import NEEDLE, TransformStatus

RIGID = 1e-2
"""By how much products of axes may differ from those of a rotation: more is no tracked tool's pose; chosen."""
IN_PLANE = 0.5
"""Share of a needle's direction that must lie in the plane of flat tissue, within 60 degrees of it; chosen."""
MOST_POINTS = 100
"""Sightings in a message: what one list may grow to; more would hold others up, chosen."""

Command = dict[str, Any]


class RefusedError(ValueError):
    """A message that is well formed, and asks for what cannot be done; instead: the commands that stand for it."""

    def __init__(self, text: str, *instead: Command) -> None:
        super().__init__(text)
        self.instead = instead


class Incoming:
    """What one client sent, as commands, each checked.

    dim: of the tissue: of a place in a plane z is left out
    State: whether the client sends the needle; its newest points, as programs send a whole list again to add one.
    """

    def __init__(self, dim: int) -> None:
        self._dim, self.sends_needle = dim, False
        self._points: frozenset[PointBody] = frozenset()

    def commands(self, message: Message) -> list[Command]:
        """The commands of a message, none where it asks for nothing that is known here.

        Raises MalformedError where its content is not of its type, RefusedError for numbers that make no sense.
        """
        if message.type == "TRANSFORM" and message.device == NEEDLE:
            return self._needle(message)
        if message.type == "POINT":
            return self._fixes(read_points(message.content))
        return []

    def _needle(self, message: Message) -> list[Command]:
        matrix = read_transform(message.content)
        self.sends_needle = True
        is_seen = message.metadata.get("TransformStatus", TransformStatus.OK) == TransformStatus.OK
        if not is_seen or not np.isfinite(matrix).all():  # some trackers say so by NaN
            return [UNSEEN]
        try:
            return [self._pose(matrix)]
        except RefusedError as error:
            raise RefusedError(str(error), UNSEEN) from error

    def _pose(self, matrix: Floats) -> Command:
        axes, place = matrix[:3, :3].astype(float), matrix[: self._dim, 3]
        with np.errstate(over="ignore", invalid="ignore"):
            rigid = bool((np.abs(axes.T @ axes - np.eye(3)) <= RIGID).all())
        if not rigid:
            raise RefusedError("needle: expected axes of length 1, square to each other")
        if np.linalg.det(axes) < 0.0:
            raise RefusedError("needle: expected a rotation, found a mirrored one")
        along = axes[: self._dim, 2]
        if np.linalg.norm(along) < IN_PLANE:
            raise RefusedError("needle: expected a direction near the plane of the tissue")
        return _checked({"command": "needle", "tip_mm": place.tolist(), "direction": along.tolist()})

    def _fixes(self, points: Iterable[PointBody]) -> list[Command]:
        sent = tuple(points)
        if len(sent) > MOST_POINTS:
            raise RefusedError(f"points: expected at most {MOST_POINTS}, found {len(sent)}")
        new = [point for point in sent if point not in self._points]
        commands = [_checked({"command": "fix", "place_mm": list(point.place_mm[: self._dim])}) for point in new]
        self._points = frozenset(sent)
        return commands


def _checked(command: Command) -> Command:
    try:
        read_command(command)
    except ValueError as error:
        raise RefusedError(str(error)) from error
    return command
