"""A recording and its estimates as ROS 2 messages in an MCAP file: what `softaim export --to mcap` does."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import UTC, datetime, timedelta
from heapq import merge
from itertools import count
from typing import BinaryIO

import cv2
import numpy as np

from experiments.formats.exchange.mcap_file import Message, write_mcap
from experiments.formats.exchange.results import Results
from experiments.formats.exchange.ros_messages import (
    IMAGE,
    POINT,
    POSE,
    TEXT,
    image_message,
    point_message,
    pose_message,
    text_message,
)
from experiments.pipeline.exchange.exported import Exported
from vision.arrays import Image

JPEG_QUALITY = 95
"""JPEG quality of the pictures, equal to that of films; choice."""

TARGET, ESTIMATE, FIX, ADVICE = "/target/pose", "/target/estimate", "/target/fix", "/advice"
PICTURES = "/camera/image/compressed"

Advance = Callable[[float], None]


def export_mcap(of: Exported, stream: BinaryIO, advance: Advance = lambda _share: None) -> dict[str, int]:
    """Write an MCAP file; returns the number of messages of each topic. Raises InputError, SourceError."""
    recording = of.recording
    topics = node_topics(recording.scene.mark_names)
    about = {
        "recording": recording.folder.name,
        "target": recording.scene.target.node,
        "time 0": (datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=of.start_ns // 1000)).isoformat(),
        "marks": json.dumps(topics, ensure_ascii=False),
    }
    streams = [_marks(of, topics), _fixes(of), _estimates(of), _advice(of)]
    if recording.source is not None:
        streams.insert(0, _pictures(of))
    first_ns, last_ns = (of.time_ns(float(recording.exposures_s[k])) for k in (0, -1))

    def messages() -> Iterator[Message]:
        for message in merge(*streams, key=lambda one: one.time_ns):
            yield message
            if first_ns < message.time_ns < last_ns:
                advance((message.time_ns - first_ns) / (last_ns - first_ns))
        advance(1.0)

    return write_mcap(stream, about, messages())


def node_topics(nodes: Iterable[str]) -> dict[str, str]:
    """The topic of each node: its name with "_" for forbidden characters. Nodes with equal topics get numbers."""
    found: dict[str, str] = {}
    for node in nodes:
        plain = re.sub(r"[^A-Za-z0-9]+", "_", node).strip("_")
        name = base = f"/marks/{plain}" if plain[:1].isalpha() else f"/marks/n{plain}"
        more = count(2)
        while name in found.values():
            name = f"{base}_{next(more)}"
        found[node] = name
    return found


def _pictures(of: Exported) -> Iterator[Message]:
    camera = of.recording.scene.cameras[0].name
    with of.recording.open_frames() as frames:
        for frame in frames:
            time_ns = of.time_ns(frame.exposure_s)
            yield Message(time_ns, PICTURES, IMAGE, image_message(time_ns, camera, _jpeg(frame.image)))


def _jpeg(image: Image) -> bytes:
    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not done:
        raise ValueError(f"image: expected one that JPEG can encode, found {image.dtype} {image.shape}")
    return data.tobytes()


def _marks(of: Exported, topics: Mapping[str, str]) -> Iterator[Message]:
    for exposure_s, marks in zip(of.recording.exposures_s, of.recording.marks or (), strict=False):
        time_ns = of.time_ns(float(exposure_s))
        for mark in marks:
            yield Message(time_ns, topics[mark.node], POINT, point_message(time_ns, mark.position_m))


def _fixes(of: Exported) -> Iterator[Message]:
    for fix in of.recording.fixes:
        time_ns = of.time_ns(fix.time_s)
        yield Message(time_ns, FIX, POSE, pose_message(time_ns, fix.position_m, fix.cov))


def _estimates(of: Exported) -> Iterator[Message]:
    """Messages for each row: the target's pose if the estimate is usable, and then all values of the estimate."""
    rows = of.estimates
    if rows is None:
        return
    trusted = rows.trusted
    for k in np.argsort(rows.times_s, kind="stable").tolist():
        time_ns = of.time_ns(float(rows.times_s[k]))
        if trusted[k]:
            yield Message(time_ns, TARGET, POSE, pose_message(time_ns, rows.means[k], rows.covs[k]))
        yield Message(time_ns, ESTIMATE, TEXT, text_message(_json(rows, k)))


def _advice(of: Exported) -> Iterator[Message]:
    rows = of.advice
    if rows is None:
        return
    for k in np.argsort(rows.times_s, kind="stable").tolist():
        yield Message(of.time_ns(float(rows.times_s[k])), ADVICE, TEXT, text_message(_json(rows, k)))


def _json(rows: Results, row: int) -> str:
    return json.dumps(rows.entries(row), ensure_ascii=False, allow_nan=False)
