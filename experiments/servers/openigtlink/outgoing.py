"""Messages for a state of the run: transforms of target, 95 % ellipsoid and needle; STATUS and STRING.

For users: docs/openigtlink.md.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Any

import numpy as np

from estimators import Advice, Status
from experiments.arrays import Floats
from experiments.servers.openigtlink.bodies import (
    LARGEST,
    StatusBody,
    pack_status,
    pack_string,
    pack_surface,
    pack_transform,
    unit_sphere,
)
from experiments.servers.openigtlink.codec import Message, encode

TARGET, NEEDLE, SPREAD = "TargetToReference", "NeedleTipToReference", "SpreadToReference"
SPHERE, HEALTH, DETAILS, REPLY = "Spread", "Softaim", "SoftaimState", "SoftaimReply"
"""Device names of the messages with the unit sphere, STATUS, STRING and answers. Each message has a name of its own,
because some programs store one message per name."""
WITHIN_95 = {2: 2.447746830680816, 3: 2.7954834829151074}
"""Semi-axes of a 95 % ellipse or ellipsoid in standard deviations, by dimension: `sqrt(chi2.ppf(0.95, dimension))`."""
FLAT_MM = 0.5
"""Half the thickness of the ellipsoid for flat tissue [mm]; choice: visible from the side."""
LONGEST_TEXT = 500
"""Largest number of letters of a reason for advice or of a fault; a STRING has room for 65535 bytes."""


class TransformStatus(StrEnum):
    """Validity of a transform in the terms of PLUS, whose clients use only transforms with OK."""

    OK = "OK"
    MISSING = "MISSING"
    """No mark was used: the transform is a prediction by the model."""
    INVALID = "INVALID"


class Code(IntEnum):
    """Codes of a STATUS, from the protocol's list."""

    OK = 1
    UNKNOWN_ERROR = 2
    NOT_FOUND = 4
    ACCESS_DENIED = 5
    BUSY = 6
    TIME_OUT = 7
    ILLEGAL_INSTRUCTION = 12
    NOT_READY = 13
    DISABLED = 15
    NOT_PRESENT = 16


@dataclass(frozen=True, slots=True)
class Packet:
    """Messages of a state as bytes: `common` for all clients; `needle` for clients that do not send a needle's pose."""

    common: bytes
    needle: bytes = b""


def packet_of(state: Mapping[str, Any]) -> Packet:
    """Messages for a state of the run."""
    utc_s, fit = state["utc_s"], transform_status(state)

    def transform(device: str, matrix: Floats | None) -> bytes:
        if fit is None or matrix is None or not (np.abs(matrix) <= LARGEST).all():
            return b""
        return encode(Message("TRANSFORM", device, pack_transform(matrix), utc_s, {"TransformStatus": str(fit)}))

    status = status_message(HEALTH, status_of(state), utc_s)
    details = encode(Message("STRING", DETAILS, pack_string(json.dumps(details_of(state))), utc_s))
    moved = transform(TARGET, target_matrix(state)) + transform(SPREAD, spread_matrix(state))
    return Packet(moved + status + details, transform(NEEDLE, needle_matrix(state)))


def sphere_message() -> bytes:
    """The unit sphere as POLYDATA; the transform `SpreadToReference` maps it to the 95 % ellipsoid."""
    return encode(Message("POLYDATA", SPHERE, pack_surface(*unit_sphere())))


def status_message(device: str, status: StatusBody, utc_s: float) -> bytes:
    """A STATUS message."""
    return encode(Message("STATUS", device, pack_status(status), utc_s))


def transform_status(state: Mapping[str, Any]) -> TransformStatus | None:
    """Validity of a state's transforms. If the target is lost, no transform is sent, and the result is None."""
    status = Status(state["status"])
    if status is Status.LOST:
        return None
    if state["fault"] is not None or state["paused"] or status in (Status.DIVERGED, Status.INITIALISING):
        return TransformStatus.INVALID
    return TransformStatus.MISSING if status is Status.COASTING else TransformStatus.OK


def status_of(state: Mapping[str, Any]) -> StatusBody:
    """The STATUS of a state: a fault if there is one, else a pause if the run is paused, else the estimate's status."""
    if state["fault"] is not None:
        return StatusBody(Code.UNKNOWN_ERROR, "FAULT", _short(state["fault"]))
    if state["paused"]:
        return StatusBody(Code.DISABLED, "PAUSED", "paused: the data are not current")
    status = Status(state["status"])
    code, text = {
        Status.TRACKING: (Code.OK, "marks are seen"),
        Status.COASTING: (Code.NOT_FOUND, "no mark is seen: predicted by the model"),
        Status.LOST: (Code.NOT_PRESENT, "no mark for too long: the target is lost, no transform is sent"),
        Status.DIVERGED: (Code.UNKNOWN_ERROR, "the marks contradict the model: not reliable"),
        Status.INITIALISING: (Code.NOT_READY, "the first marks: not yet reliable"),
    }[status]
    return StatusBody(code, str(status), text)


def details_of(state: Mapping[str, Any]) -> dict[str, Any]:
    """Content of the message of type STRING: status, covariance, hit probability and advice.

    If the state's transforms are invalid, or if no transforms are sent, the advice GO is omitted.
    """
    fit, advice = transform_status(state), state["advice"] or {}
    if advice.get("advice") == Advice.GO and fit not in (TransformStatus.OK, TransformStatus.MISSING):
        advice = {}
    details = {key: state[key] for key in ("utc_s", "time_s", "status", "fault", "paused")} | {"transform_status": fit}
    details |= {key: state[key] for key in ("cov_mm2", "sigma_mm", "marks_used", "nis", "poked")}
    details |= {key: advice.get(key) for key in ("probability", "advice", "reason")}
    return details | {key: _short(details[key]) for key in ("fault", "reason") if details[key] is not None}


def target_matrix(state: Mapping[str, Any]) -> Floats | None:
    """Matrix (4, 4) of a frame with the scene's axes and its origin in the target; None if the target is unknown."""
    if state["target_mm"] is None:
        return None
    matrix = np.eye(4)
    matrix[: len(state["target_mm"]), 3] = state["target_mm"]
    return matrix


def spread_matrix(state: Mapping[str, Any]) -> Floats | None:
    """Right-handed matrix (4, 4) that maps the unit sphere to the 95 % ellipsoid; None if there is no covariance.

    For flat tissue, the ellipsoid meets the plane in the 95 % ellipse. It extends FLAT_MM above and below the plane.
    """
    matrix = target_matrix(state)
    if matrix is None or state["cov_mm2"] is None:
        return None
    cov = np.array(state["cov_mm2"])
    dim = len(cov)
    values, vectors = np.linalg.eigh(cov)
    axes = FLAT_MM * np.eye(3)
    axes[:dim, :dim] = vectors * (WITHIN_95[dim] * np.sqrt(values.clip(0.0)))
    if np.linalg.det(vectors) < 0.0:
        axes[:, 0] *= -1.0
    matrix[:3, :3] = axes
    return matrix


def needle_matrix(state: Mapping[str, Any]) -> Floats | None:
    """Matrix (4, 4) of a frame with origin in the needle's tip and +z along the insertion; None if there is no needle.

    The shaft lies along -z, as in SlicerIGT's calibrations of needles. The rotation about the needle is unknown and is
    chosen as in [duff2017], section 3.
    """
    needle = state["needle"]
    if needle is None or needle["tip_mm"] is None:
        return None
    tip, along = np.zeros(3), np.zeros(3)
    tip[: len(needle["tip_mm"])], along[: len(needle["direction"])] = needle["tip_mm"], needle["direction"]
    length = float(np.linalg.norm(along))
    if not 0.0 < length < np.inf:
        return None
    n = along / length
    x, y, z = n.tolist()
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = a * x * y
    matrix = np.eye(4)
    matrix[:3, 0] = 1.0 + sign * a * x * x, sign * b, -sign * x
    matrix[:3, 1] = b, sign + a * y * y, -y
    matrix[:3, 2], matrix[:3, 3] = n, tip
    return matrix


def _short(text: str) -> str:
    return text if len(text) <= LONGEST_TEXT else text[: LONGEST_TEXT - 1] + "…"
