"""ROS 2 messages as their own tools read them."""

from functools import cache

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from experiments.formats.exchange.cdr import Cdr
from experiments.formats.exchange.ros_messages import (
    DEFINITIONS,
    IMAGE,
    POINT,
    POSE,
    TEXT,
    image_message,
    point_message,
    pose_message,
    text_message,
)

TIME_NS = 1_769_850_000_123_456_789


@cache
def decoder(kind: str):
    """That of mcap-ros2-support, by the definition that stands in the file."""
    schema = Schema(id=1, name=kind, encoding="ros2msg", data=DEFINITIONS[kind].encode())
    decode = DecoderFactory().decoder_for("cdr", schema)
    assert decode is not None
    return decode


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


def test_what_is_flat_is_in_the_plane() -> None:
    found = decoded(POSE, pose_message(0, np.array([1.0, 2.0]), np.array([[3.0, 0.5], [0.5, 4.0]])))
    place = found.pose.pose.position
    assert (place.x, place.y, place.z) == (1.0, 2.0, 0.0)
    assert list(found.pose.covariance[:8]) == [3.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.5, 4.0]
    assert not any(found.pose.covariance[8:])
    point = decoded(POINT, point_message(0, np.array([1.0, 2.0]))).point
    assert (point.x, point.y, point.z) == (1.0, 2.0, 0.0)


@settings(max_examples=20)
@given(st.text(max_size=20), st.binary(max_size=40))
def test_pictures_and_texts_of_any_length_are_aligned(name: str, data: bytes) -> None:
    found = decoded(IMAGE, image_message(TIME_NS, name, data))
    assert (found.header.frame_id, found.format, bytes(found.data)) == (name, "jpeg", data)
    assert decoded(TEXT, text_message(name)).data == name


@given(st.text(max_size=9))
def test_numbers_after_a_text_stand_at_multiples_of_their_size(text: str) -> None:
    """[ddsi-rtps]: counted from the end of the header of four bytes, which is not part of the message."""
    data = Cdr().text(text).doubles([1.5]).content()
    assert data[:4] == b"\x00\x01\x00\x00"
    assert data.endswith(np.array(1.5).tobytes())
    length = 4 + len(text.encode()) + 1
    assert len(data) == 4 + -(-length // 8) * 8 + 8
