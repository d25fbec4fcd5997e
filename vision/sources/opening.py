"""Open a source of frames by its name: camera index, device, film, folder of pictures or stream."""

from __future__ import annotations

import os
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
from vision.sources.frames import FilePath, SourceError, VideoFileFrames, opencv_name
from vision.sources.live import LiveFrames
from vision.sources.picture_folder import PictureFolderFrames
from vision.sources.playback import Playback, Start
from vision.sources.settings import DEFAULTS, SourceSettings

LAST_CAMERA = 99
"""Largest camera index. OpenCV takes the hundreds of a larger index for the number of a capture API."""
SCHEMES = ("rtsp", "rtsps", "rtmp", "http", "https", "udp", "tcp")


def open_source(
    spec: FilePath,
    *,
    live: bool,
    fps: float | None = None,
    give_up_s: float | None = None,
    settings: SourceSettings = DEFAULTS,
) -> Source:
    """Open a source of frames.

    spec: camera index, /dev/video..., film, folder of pictures, or stream (rtsp://, http://, udp:// ...)
    live: if True, only the newest frame is delivered, and a file is played at the speed of its exposure times. If
        False, a file is read as fast as requested; for a device or stream, up to settings.backlog frames can wait.
    fps: frame rate [frames/s]. A folder of pictures needs fps. If given for a film, fps replaces the film's times.
    give_up_s, settings: as in `LiveFrames`

    Raises SourceError if there is no such source, or if fps is given for a camera or stream. If a device cannot be
    opened, the first `next` raises SourceError.
    """
    opencv_name(spec)  # raises SourceError
    spec, path = os.fspath(spec), Path(spec)
    ends: Callable[[Any], bool] = _never
    if spec.isascii() and spec.isdecimal():
        if int(spec) > LAST_CAMERA:
            raise SourceError(f"{spec}: expected a camera index from 0 to {LAST_CAMERA}, found more")
        opened = partial(cv2.VideoCapture, int(spec))
    elif "://" in spec:
        if urlsplit(spec).scheme.lower() not in SCHEMES:
            raise SourceError(f"{shown_source(spec)}: expected {', '.join(SCHEMES)} before ://, found another")
        open_ms, read_ms = round(1e3 * settings.stream_opening_s), round(1e3 * settings.hung_s)
        waits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, open_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, read_ms]
        opened, ends = partial(cv2.VideoCapture, spec, cv2.CAP_FFMPEG, waits), _has_length
    elif path.is_char_device():
        # The API is stated, because FFmpeg would otherwise first read the device as a file.
        opened = partial(cv2.VideoCapture, spec, cv2.CAP_V4L2)
    else:
        return from_file(_file(spec, fps), live=live)
    if fps is not None:
        raise SourceError(f"{shown_source(spec)}: expected no fps beside a camera or stream, found {fps:g}")
    keep = 1 if live else settings.backlog
    return LiveFrames(opened, ends=ends, keep=keep, give_up_s=give_up_s, settings=settings)


def from_file(frames: FrameFile, *, live: bool) -> Source:
    """Source of a file's frames. If live is true, the file is `played`. Otherwise, frames are read when requested."""
    return played(frames) if live else EveryFrame(frames)


def played(frames: FrameFile, start: Start | None = None) -> LiveFrames:
    """Source that plays a file and delivers its newest frame, at the time when this frame is due; see `Playback`."""
    playback = Playback(frames, start)
    return LiveFrames(
        lambda: playback,
        ends=lambda _capture: True,
        exposures=lambda: stated_exposure_time,
        may_repeat=True,
        origin=lambda: playback.origin_s,
        waits=True,
    )


def _never(_capture: Any) -> bool:
    return False


def _has_length(capture: Any) -> bool:
    """Whether a capture states its number of frames. Such a capture is a film on a server, not a stream."""
    return bool(capture.get(cv2.CAP_PROP_FRAME_COUNT) > 0)


def _file(spec: str, fps: float | None) -> FrameFile:
    path = Path(spec)
    if path.is_dir():
        if fps is None:
            raise SourceError(f"{spec}: expected fps, frames a second, beside a folder of pictures, found none")
        return PictureFolderFrames(path, fps)
    if path.exists():
        return VideoFileFrames(path, fps=fps)
    raise SourceError(f"{spec}: expected a camera index, a device, a film, a folder or a stream, found none of them")


def shown_source(spec: str) -> str:
    """Name of a source for messages, without the password that a stream's address may contain."""
    return re.sub(r"(?<=://)[^/@]*@", "", spec)
