"""Writing of films, and JPEG compression of pictures."""

from __future__ import annotations

import os
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

import cv2
import numpy as np

from vision.arrays import Image
from vision.sources.frames import FilePath, SourceError, opencv_name, quiet_opencv, whole_packets

Codec = Literal["MJPG", "FFV1"]
"""Compression of a film: MJPG stores each frame as a JPEG; FFV1 is lossless."""


class VideoWriter:
    """Writer of a film. The file has a temporary name until the film is complete.

    codec: see `Codec`. MJPG needs a path that ends in .avi.
    quality: JPEG quality, 1 to 100
    If an exception is raised in the writer's `with` block, the file is deleted.
    """

    def __init__(
        self, path: FilePath, size_px: tuple[int, int], fps: float, codec: Codec = "MJPG", quality: int = 95
    ) -> None:
        if codec not in ("MJPG", "FFV1"):
            raise ValueError(f"codec: expected MJPG or FFV1, found {codec}")
        if not 1 <= quality <= 100:
            raise ValueError(f"quality: expected 1 to 100, found {quality}")
        if not fps > 0:
            raise ValueError(f"fps: expected more than 0, found {fps}")
        self.path = Path(path)
        self.size_px = size_px
        self.n_frames = 0
        self._ended = False
        # The suffix is last, because OpenCV chooses the container by it. The process id distinguishes two writers.
        self._partial = self.path.with_name(f".{self.path.stem}.{os.getpid()}.partial{self.path.suffix}")
        # Only OpenCV's own MJPG writer has a quality, and it writes only .avi.
        api = cv2.CAP_OPENCV_MJPEG if codec == "MJPG" else cv2.CAP_FFMPEG
        name = opencv_name(self._partial)
        with quiet_opencv():
            self._writer = cv2.VideoWriter(name, api, cv2.VideoWriter.fourcc(*codec), fps, size_px)
            opened = self._writer.isOpened()
            if opened and codec == "MJPG":
                self._writer.set(cv2.VIDEOWRITER_PROP_QUALITY, quality)
        if not opened:
            self._partial.unlink(missing_ok=True)
            raise SourceError(f"{self.path}: expected a path where a {codec} video can be written, found none")

    def write(self, image: Image) -> None:
        """Append a frame, (height, width, 3) BGR uint8."""
        expected = (self.size_px[1], self.size_px[0], 3)
        if image.dtype != np.uint8 or image.shape != expected:
            raise ValueError(f"{self.path}: expected uint8 frames {expected}, found {image.dtype} {image.shape}")
        self._writer.write(image)
        self.n_frames += 1

    def close(self, *, sync: bool = False) -> None:
        """Finish the film, then rename the file to its final name.

        sync: whether to write the file to the disk before it is renamed
        If frames are missing, for example because the disk is full, the film is deleted, and SourceError is raised.
        If this call is interrupted, it can be repeated.
        """
        if self._ended:
            return
        self._writer.release()
        there = self._partial.exists()
        if there or not self.path.exists():  # otherwise an earlier call was interrupted after the renaming
            n_found = sum(1 for _ in whole_packets(self._partial)) if there and self.n_frames else 0
            if not there or n_found < self.n_frames:
                self._partial.unlink(missing_ok=True)
                raise SourceError(f"{self.path}: expected room for {self.n_frames} frames, found it for {n_found}")
            if sync:
                with self._partial.open("rb") as file:
                    os.fsync(file.fileno())
            os.replace(self._partial, self.path)
        self._ended = True

    def discard(self) -> None:
        """Stop, and delete the file."""
        self._writer.release()
        self._partial.unlink(missing_ok=True)
        self._ended = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()


def compress(image: Image, quality: int) -> Image:
    """The image, (height, width, 3), after JPEG compression and decompression. quality: JPEG quality, 1 to 100."""
    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ValueError(f"image: expected one that JPEG can encode, found {image.dtype} {image.shape}")
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)
