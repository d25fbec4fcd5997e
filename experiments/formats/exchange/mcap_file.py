"""MCAP with ROS 2 messages, as in rosbag2 and Foxglove."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import BinaryIO

from experiments.extras import require
from experiments.formats.exchange.ros_messages import DEFINITIONS
from experiments.version import version


@dataclass(frozen=True, slots=True)
class Message:
    """A message of an MCAP file: its time [ns], its topic, its kind as in `DEFINITIONS`, and its bytes."""

    time_ns: int
    topic: str
    kind: str
    data: bytes


def write_mcap(stream: BinaryIO, metadata: Mapping[str, str], messages: Iterable[Message]) -> dict[str, int]:
    """Write a file; returns the number of messages of each topic. Raises InputError if the extra `export` is missing.

    metadata: data on the recording, written as the record `softaim`
    """
    require("--to mcap", "export")
    from mcap.writer import Writer

    writer = Writer(stream)
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    counts: dict[str, int] = {}
    writer.start(profile="ros2", library=f"softaim {version()}")
    writer.add_metadata("softaim", dict(metadata))
    for message in messages:
        topic, kind, time_ns = message.topic, message.kind, message.time_ns
        if kind not in schemas:
            schemas[kind] = writer.register_schema(kind, "ros2msg", DEFINITIONS[kind].encode())
        if topic not in channels:
            channels[topic], counts[topic] = writer.register_channel(topic, "cdr", schemas[kind]), 0
        writer.add_message(channels[topic], time_ns, message.data, time_ns, counts[topic])
        counts[topic] += 1
    writer.finish()
    return counts
