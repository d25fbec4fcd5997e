"""MCAP with ROS 2 messages, as in rosbag2 and Foxglove."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, BinaryIO

from experiments.extras import require
from experiments.formats.exchange.ros_messages import DEFINITIONS
from experiments.version import version

if TYPE_CHECKING:
    from mcap.writer import Writer


@dataclass(frozen=True, slots=True)
class Message:
    """A message of an MCAP file: its time [ns], its topic, its kind as in `DEFINITIONS`, and its bytes."""

    time_ns: int
    topic: str
    kind: str
    data: bytes


class McapFile:
    """An MCAP file while it is written; `mcap_file` opens it.

    State: the writer; schema ids by kind; channel ids and numbers of messages by topic.
    """

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self.counts: dict[str, int] = {}

    def write(self, message: Message) -> None:
        """Append a message."""
        topic, kind = message.topic, message.kind
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", DEFINITIONS[kind].encode())
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[kind])
            self.counts[topic] = 0
        time_ns, count = message.time_ns, self.counts[topic]
        self._writer.add_message(self._channels[topic], time_ns, message.data, time_ns, count)
        self.counts[topic] = count + 1


@contextmanager
def mcap_file(stream: BinaryIO, metadata: Mapping[str, str]) -> Iterator[McapFile]:
    """Open a file for messages; a clean exit completes the file. InputError if the package is not installed.

    metadata: data on the recording, written as the record `softaim`
    """
    require("--to mcap", "export")
    from mcap.writer import Writer

    writer = Writer(stream)
    writer.start(profile="ros2", library=f"softaim {version()}")
    writer.add_metadata("softaim", dict(metadata))
    yield McapFile(writer)
    writer.finish()
