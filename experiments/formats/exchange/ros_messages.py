"""ROS 2 messages that are exported: definitions, and encoding as CDR.

The encoding is plain CDR, version 1, little-endian, see [corba] and [ddsi-rtps].
Definitions are those of ROS 2's common_interfaces, unchanged since Foxy. Lengths are in metres, stamps in nanoseconds.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.arrays import Floats

HEADER = b"\x00\x01\x00\x00"
"""Header of plain CDR in little-endian order without options."""

FRAME = "reference"
"""Name of the frame with the scene's axes: x right, y up, z toward the camera."""

POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
POINT = "geometry_msgs/msg/PointStamped"
IMAGE = "sensor_msgs/msg/CompressedImage"
TEXT = "std_msgs/msg/String"

_PARTS: Mapping[str, str] = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
}
_STAMPED = ("std_msgs/Header", "builtin_interfaces/Time")
_POSED = ("geometry_msgs/PoseWithCovariance", "geometry_msgs/Pose", "geometry_msgs/Point", "geometry_msgs/Quaternion")


def _definition(own: str, *parts: str) -> str:
    """A message definition, followed by the definitions of nested messages, in the format of MCAP and rosbag2."""
    return f"\n{'=' * 80}\n".join([own, *(f"MSG: {part}\n{_PARTS[part]}" for part in parts)]) + "\n"


DEFINITIONS: Mapping[str, str] = {
    POSE: _definition("std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose", *_STAMPED, *_POSED),
    POINT: _definition("std_msgs/Header header\ngeometry_msgs/Point point", *_STAMPED, "geometry_msgs/Point"),
    IMAGE: _definition("std_msgs/Header header\nstring format\nuint8[] data", *_STAMPED),
    TEXT: _definition("string data"),
}
"""Definition of each message type, in the encoding `ros2msg`."""


def encoded(form: str, *values: Any) -> bytes:
    """A message with these values; `form` has one letter for each value.

    i, I, d: a number as in `struct`, aligned to a multiple of its size; s: text; b: bytes
    Text and bytes begin with their length; text ends with a zero byte. An array of fixed length is one value per entry.
    """
    body = bytearray()
    for code, value in zip(form, values, strict=True):
        content = value.encode("utf-8") + b"\x00" if code == "s" else value
        kind, number = ("<I", len(content)) if code in "sb" else (f"<{code}", value)
        body += bytes(-len(body) % struct.calcsize(kind)) + struct.pack(kind, number)
        if code in "sb":
            body += content
    return HEADER + bytes(body)


def pose_message(time_ns: int, mean: Floats, cov: Floats) -> bytes:
    """Message of the target's position [m], (dim,), with its covariance [m²], (dim, dim).

    The rotation is the identity, because the target has no orientation. In the plane z is 0. Covariances of the
    rotation, and of z in the plane, are 0.
    """
    whole = np.zeros((6, 6))
    whole[: len(mean), : len(mean)] = cov
    pose = [*_point(mean), 0.0, 0.0, 0.0, 1.0, *whole.ravel()]
    return encoded("iIs" + len(pose) * "d", *divmod(time_ns, 10**9), FRAME, *pose)


def point_message(time_ns: int, place: Floats) -> bytes:
    """Message of a position [m], (dim,)."""
    return encoded("iIsddd", *divmod(time_ns, 10**9), FRAME, *_point(place))


def image_message(time_ns: int, frame_id: str, jpeg: bytes) -> bytes:
    """Message of a picture in JPEG format."""
    return encoded("iIssb", *divmod(time_ns, 10**9), frame_id, "jpeg", jpeg)


def text_message(text: str) -> bytes:
    """Message with a text and without a stamp."""
    return encoded("s", text)


def _point(place: Floats) -> list[float]:
    return [*map(float, place), *[0.0] * (3 - len(place))]
