"""ROS 2 messages as their own tools read them."""

from functools import cache

import numpy as np
import pytest
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from experiments.formats.exchange.ros_messages import (
    DEFINITIONS,
    IMAGE,
    POSE,
    TEXT,
    image_message,
    pose_message,
    text_message,
)

TIME_NS = 1_769_850_000_123_456_789


@cache
def decoder(kind: str):
    """That of mcap-ros2-support, by the definition that stands in the file."""
    schema = Schema(id=1, name=kind, encoding="ros2msg", data=DEFINITIONS[kind].encode())
    return DecoderFactory().decoder_for("cdr", schema)


def decoded(kind: str, data: bytes):
    return decoder(kind)(data)


def test_a_pose_with_covariance() -> None:
    cov = np.array([[4.0, 1.0, 0.5], [1.0, 9.0, -2.0], [0.5, -2.0, 16.0]])
    found = decoded(POSE, pose_message(TIME_NS, np.array([0.1, -0.2, 0.3]), cov))
    assert (found.header.stamp.sec, found.header.stamp.nanosec) == (1_769_850_000, 123_456_789)
    assert found.header.frame_id == "reference"
    place, turned = found.pose.pose.position, found.pose.pose.orientation
    assert (place.x, place.y, place.z) == (0.1, -0.2, 0.3)
    assert (turned.x, turned.y, turned.z, turned.w) == (0.0, 0.0, 0.0, 1.0)
    whole = np.reshape(found.pose.covariance, (6, 6))
    assert (whole[:3, :3] == cov).all()
    assert not whole[3:].any()
    assert not whole[:, 3:].any()


@pytest.mark.parametrize("name", ["", "ab", "é", "camera"])
@pytest.mark.parametrize("n_bytes", range(5))
def test_pictures_and_texts_of_any_length_are_aligned(name: str, n_bytes: int) -> None:
    data = bytes(range(1, 1 + n_bytes))
    found = decoded(IMAGE, image_message(TIME_NS, name, data))
    assert (found.header.frame_id, found.format, bytes(found.data)) == (name, "jpeg", data)
    assert decoded(TEXT, text_message(name)).data == name
