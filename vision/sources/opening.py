"""One way to frames from whatever a person names: camera, device, film, folder, stream."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import cv2

from vision.sources.events import Source
from vision.sources.every_frame import EveryFrame, FrameFile
from vision.sources.exposure_times import stated_exposure_time
from vision.sources.frames import SourceError, VideoFileFrames
from vision.sources.live import LiveFrames
from vision.sources.picture_folder import PictureFolderFrames
from vision.sources.playback import Playback

LAST_CAMERA = 99
"""Greatest camera index: OpenCV takes the hundreds for the number of a programming interface."""
SCHEMES = ("rtsp", "rtsps", "rtmp", "http", "https", "udp", "tcp")
OPEN_MS, READ_MS = 5000, 2000
"""How long FFmpeg may wait for a stream to open, and for its next packet; its own 30 s are too long; chosen."""
DEVICE_BACKLOG = 64
"""Frames of a device that wait where every one counts: 2 s at 30 frames/s; chosen."""


def open_source(
    spec: str,
    *,
    live: bool,
    fps: float | None = None,
    blocked_s: float = 0.5,
    frozen_s: float = 0.5,
    give_up_s: float | None = None,
) -> Source:
    """Frames of a camera index, /dev/video..., film, folder of pictures or stream (rtsp://, http://, udp:// ...).

    live: the newest frame wins, files are shown at their own pace; else every frame counts: files as fast as they are
        asked for, and of devices and streams so many wait that a pause of two seconds at 30 frames/s loses none
    fps: of a folder of pictures, which has no times of its own
    blocked_s, frozen_s, give_up_s: when faults of a device or stream are told; see `LiveFrames`

    Raises SourceError for what is not there. A device that does not open is told by the first `next`.
    """
    path = Path(spec)
    ends: Callable[[Any], bool] = _never
    if spec.isascii() and spec.isdecimal():
        if int(spec) > LAST_CAMERA:
            raise SourceError(f"{spec}: expected a camera index from 0 to {LAST_CAMERA}, found more")
        opened = partial(cv2.VideoCapture, int(spec))
    elif "://" in spec:
        if urlsplit(spec).scheme.lower() not in SCHEMES:
            raise SourceError(f"{shown_source(spec)}: expected {', '.join(SCHEMES)} before ://, found another")
        waits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, OPEN_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, READ_MS]
        opened, ends = partial(cv2.VideoCapture, spec, cv2.CAP_FFMPEG, waits), _has_length
    elif path.is_char_device():
        # The API is named, or FFmpeg would read the device as a file first.
        opened = partial(cv2.VideoCapture, spec, cv2.CAP_V4L2)
    else:
        return from_file(_file(spec, fps), live=live)
    keep = 1 if live else DEVICE_BACKLOG
    return LiveFrames(opened, ends=ends, keep=keep, blocked_s=blocked_s, frozen_s=frozen_s, give_up_s=give_up_s)


def from_file(frames: FrameFile, *, live: bool) -> Source:
    """The frames of a file: live at their own pace, the newest one first; else every one."""
    if not live:
        return EveryFrame(frames)
    playback = Playback(frames)
    return LiveFrames(
        lambda: playback, ends=lambda _capture: True, exposures=lambda: stated_exposure_time, frozen_s=None
    )


def _never(_capture: Any) -> bool:
    return False


def _has_length(capture: Any) -> bool:
    """Whether it is a film on a server, which ends; a stream has no length."""
    return bool(capture.get(cv2.CAP_PROP_FRAME_COUNT) > 0)


def _file(spec: str, fps: float | None) -> FrameFile:
    path = Path(spec)
    if path.is_dir():
        if fps is None:
            raise SourceError(f"{spec}: expected fps, frames a second, beside a folder of pictures, found none")
        return PictureFolderFrames(path, fps)
    if path.exists():
        return VideoFileFrames(path)
    raise SourceError(f"{spec}: expected a camera index, a device, a film, a folder or a stream, found none of them")


def shown_source(spec: str) -> str:
    """The name of a source as messages repeat it: without the password that a stream's address may hold."""
    return re.sub(r"(?<=://)[^/@]*@", "", spec)
