"""Conversion of a client's messages into commands: TRANSFORM is a tracked needle, POINT has positions of the target."""

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
"""Largest deviation of `R.T @ R` from the identity for a valid rotation R [1]; choice: tracked poses deviate less."""
IN_PLANE = 0.5
"""Least length [1] of the needle's unit vector when projected onto the plane of flat tissue; choice: at most 60 degrees
between the needle and the plane."""
MOST_POINTS = 100
"""Largest number of points in a message; choice: more would delay other clients."""

Command = dict[str, Any]


class RefusedError(ValueError):
    """Error for a well-formed message whose request is impossible; `instead`: commands that replace the request."""

    def __init__(self, text: str, *instead: Command) -> None:
        super().__init__(text)
        self.instead = instead


class Incoming:
    """Converter of one client's messages into checked commands.

    dim: dimension of the tissue; z is ignored if the tissue is flat; sends_needle: whether the client has sent a needle
    Some programs send all points again when the user adds a point. Therefore a point becomes a direct measurement of
    the target (fix) only if it was not in the client's last POINT message.
    """

    def __init__(self, dim: int) -> None:
        self._dim, self.sends_needle = dim, False
        self._points: frozenset[PointBody] = frozenset()

    def commands(self, message: Message) -> list[Command]:
        """The commands in a message; an empty list if the message's type and name are not known.

        Raises MalformedError if the message's content does not fit its type, RefusedError for invalid numbers.
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
        if not is_seen or not np.isfinite(matrix).all():  # some trackers send NaN if the needle is not visible
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
            raise RefusedError("needle: expected axes of length 1, perpendicular to each other")
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
