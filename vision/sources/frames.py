"""Frames of films and folders, in order, each with its exposure time."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np

from vision.arrays import Image
from vision.sources.exposure_times import FilmTimes

# FFmpeg's messages bypass OpenCV's log. FFmpeg reads its log level when the first film is opened. -8 is AV_LOG_QUIET.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


FilePath = str | os.PathLike[str]
"""Path of a file or folder."""

JPEG_BEGIN, JPEG_END = b"\xff\xd8", b"\xff\xd9"
"""First and last bytes of a JPEG."""


class SourceError(ValueError):
    """Error for frames that are not available. The message names the source, what was expected and what was found."""


class Closing(ABC):
    """Base class of context managers that call `close` at the end of their block."""

    @abstractmethod
    def close(self) -> None:
        """Release the resource."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_fault: object) -> None:
        self.close()


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One picture: its index in the source, its exposure time [s], and the pixels, (height, width, 3) BGR."""

    index: int
    exposure_s: float
    image: Image


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """Simultaneous pictures. exposure_s: exposure time [s]; images: picture of each camera, (height, width, 3) BGR."""

    exposure_s: float
    images: dict[str, Image]


def bgr(picture: Any) -> Image:
    """Convert a grey, BGR or BGRA picture of 8 or 16 bits to (height, width, 3) BGR of 8 bits.

    Raises ValueError for any other picture.
    """
    image = np.asarray(picture)
    levels = {np.dtype(np.uint8): 1, np.dtype(np.uint16): 257}.get(image.dtype)
    channels = 1 if image.ndim == 2 else image.shape[2] if image.ndim == 3 else 0
    if levels is None or channels not in (1, 3, 4):
        raise ValueError(f"picture: expected 1, 3 or 4 channels of 8 or 16 bits, found {image.shape}, {image.dtype}")
    if levels > 1:
        image = (image // levels).astype(np.uint8)
    if channels == 1:
        return np.repeat(image.reshape(*image.shape[:2], 1), 3, axis=2)
    return np.ascontiguousarray(image[..., :3]) if channels == 4 else image


@contextmanager
def quiet_opencv() -> Iterator[None]:
    """Suppress OpenCV's warnings on the terminal."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)


def opencv_name(path: FilePath) -> str:
    """Name of a file for OpenCV and FFmpeg. Raises SourceError for a name that is not in UTF-8.

    A relative name gets ./ in front, because FFmpeg reads the part of a name before a colon as a protocol.
    """
    name = os.fspath(path)
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        shown = os.fsencode(name).decode("utf-8", "backslashreplace")
        raise SourceError(f"{shown}: expected a name in UTF-8, found other bytes") from None
    return name if os.path.isabs(name) else os.path.join(os.curdir, name)


def read_picture(path: Path, flags: int = cv2.IMREAD_COLOR) -> Image:
    """Pixels of a picture file, (height, width, 3) BGR or (height, width). Raises SourceError if it is unreadable."""
    name = opencv_name(path)
    with quiet_opencv():
        image = cv2.imread(name, flags)
    if image is None:
        raise SourceError(f"{path}: expected a picture, found a file that cannot be read as one")
    return np.asarray(image, dtype=np.uint8)


def size_text(image: Image) -> str:
    """Width and height of a picture for a message, such as 640x480."""
    return f"{image.shape[1]}x{image.shape[0]}"


class VideoFileFrames(Closing):
    """Frames of a film, as fast as they are requested.

    exposures_s: exposure time of each frame [s]; default: index / fps
    fps: frame rate [frames/s]; default: the times in the film determine the exposure times, see `FilmTimes`

    Raises SourceError if the film cannot be opened. Iteration raises SourceError if the film has no times, or if the
    numbers of frames and exposure times differ.
    """

    def __init__(self, path: FilePath, exposures_s: Sequence[float] | None = None, *, fps: float | None = None) -> None:
        self.path, self._fps = Path(path), fps
        self._exposures = None if exposures_s is None else [float(t) for t in exposures_s]
        self._capture = _opened(self.path)

    def __iter__(self) -> Iterator[Frame]:
        film_times = FilmTimes(self._capture.get(cv2.CAP_PROP_FPS))
        index = 0
        while (image := self._next_image()) is not None:
            if self._exposures is None:
                yield Frame(index, self._own_time(film_times) if self._fps is None else index / self._fps, image)
            elif index < len(self._exposures):
                yield Frame(index, self._exposures[index], image)
            else:
                raise SourceError(f"{self.path}: expected {len(self._exposures)} frames, found more")
            index += 1
        if self._exposures is not None and index < len(self._exposures):
            raise SourceError(f"{self.path}: expected {len(self._exposures)} frames, found {index}")

    def _own_time(self, film_times: FilmTimes) -> float:
        try:
            return film_times(1e-3 * self._capture.get(cv2.CAP_PROP_POS_MSEC))
        except ValueError as error:
            raise SourceError(f"{self.path}: {error}") from None

    def _next_image(self) -> Image | None:
        with quiet_opencv():
            read, image = self._capture.read()
        return np.asarray(image, dtype=np.uint8) if read else None

    def close(self) -> None:
        """Close the file."""
        self._capture.release()


class FolderFrames(Closing):
    """Pictures 000000.png, 000001.png ... of a folder, with their exposure times [s].

    Raises SourceError if the numbers of pictures and exposure times differ, or if a picture is missing, unreadable or
    of another size than the first.
    """

    def __init__(self, folder: FilePath, exposures_s: Sequence[float]) -> None:
        self.folder = Path(folder)
        self._exposures = [float(t) for t in exposures_s]
        if not self.folder.is_dir():
            raise SourceError(f"{self.folder}: expected a folder of frames, found none")
        n_frames = count_numbered(self.folder)
        if n_frames != len(self._exposures):
            raise SourceError(f"{self.folder}: expected {len(self._exposures)} frames, found {n_frames}")

    def __iter__(self) -> Iterator[Frame]:
        size = ""
        for index, exposure in enumerate(self._exposures):
            path = self.folder / f"{index:06d}.png"
            if not path.is_file():
                raise SourceError(f"{path}: expected frame {index}, found no such file")
            image = read_picture(path)
            size = size or size_text(image)
            if size_text(image) != size:
                raise SourceError(f"{path}: expected {size}, found {size_text(image)}")
            yield Frame(index, exposure, image)

    def close(self) -> None:
        """Nothing to release."""


def count_numbered(folder: FilePath) -> int:
    """Number of PNG pictures in a folder; files that begin with a dot are not pictures."""
    return len(list(Path(folder).glob("[!.]*.png")))


def count_frames(path: FilePath, advance: Callable[[float], None] = lambda _share: None) -> int:
    """Number of frames in a film, found by reading the whole film. Raises SourceError if the film cannot be opened.

    advance: called after each frame with the share of frames read so far, 0 to 1, estimated from the film's header
    """
    capture = _opened(Path(path))
    n_frames, expected = 0, max(capture.get(cv2.CAP_PROP_FRAME_COUNT), 1.0)
    with quiet_opencv():
        while capture.grab():
            n_frames += 1
            advance(min(n_frames / expected, 1.0))
    capture.release()
    return n_frames


def whole_packets(path: Path) -> Iterator[Image]:
    """The compressed bytes of each frame of a film, (n_bytes,), up to the first incomplete frame."""
    with quiet_opencv():
        capture = cv2.VideoCapture(opencv_name(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
    try:
        while True:
            read, packet = capture.read()
            if not read:
                return
            packet = np.asarray(packet, dtype=np.uint8).ravel()
            data = packet.tobytes()
            if data.startswith(JPEG_BEGIN) and not data.rstrip(b"\0").endswith(JPEG_END):
                return
            yield packet
    finally:
        capture.release()


def _opened(path: Path) -> cv2.VideoCapture:
    if not path.is_file():
        raise SourceError(f"{path}: expected a video file, found no such file")
    with quiet_opencv():
        # The API is stated, because OpenCV would otherwise read a name with digits as a pattern of pictures.
        capture = cv2.VideoCapture(opencv_name(path), cv2.CAP_FFMPEG)
        opened = capture.isOpened() and capture.get(cv2.CAP_PROP_FRAME_WIDTH) > 0
    if not opened:
        raise SourceError(f"{path}: expected a video that OpenCV can decode, found none")
    return capture
