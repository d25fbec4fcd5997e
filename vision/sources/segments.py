"""Film in numbered pieces. If the writing process is killed, all complete pieces remain readable."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import cv2

from vision.arrays import Image
from vision.sources.frames import (
    Closing,
    FilePath,
    Frame,
    SourceError,
    VideoFileFrames,
    count_frames,
    opencv_name,
    quiet_opencv,
    whole_packets,
)
from vision.sources.video import Codec, VideoWriter

SUFFIX: dict[Codec, str] = {"FFV1": ".mkv", "MJPG": ".avi"}
"""File name extension of a piece, by codec."""

NOMINAL_FPS = 30.0
"""Frame rate in the header of a piece [frames/s]. Readers use given exposure times in place of this rate."""


class SegmentWriter:
    """Writer of a film in numbered pieces: 000000.mkv ... (FFV1) or 000000.avi ... (MJPG).

    The unfinished piece is a hidden file. If `finish` is interrupted, it can be called again.
    folder: existing empty folder
    n_whole: number of complete pieces
    """

    def __init__(self, folder: FilePath, size_px: tuple[int, int], codec: Codec = "FFV1") -> None:
        self.folder, self.size_px, self.codec = Path(folder), size_px, codec
        self.n_whole = 0
        self._piece: VideoWriter | None = None

    def write(self, image: Image) -> None:
        """Append a frame, (height, width, 3) BGR uint8, to the unfinished piece, or to a new piece if there is none."""
        if self._piece is None:
            path = self.folder / f"{self.n_whole:06d}{SUFFIX[self.codec]}"
            self._piece = VideoWriter(path, self.size_px, NOMINAL_FPS, codec=self.codec)
        self._piece.write(image)

    def finish(self) -> None:
        """End the unfinished piece: sync its file to the disk, then rename the file to its final name.

        If frames of the piece are missing, the piece is deleted, and SourceError is raised.
        """
        if self._piece is not None:
            self._piece.close(sync=True)
            self.n_whole = int(self._piece.path.stem) + 1
            self._piece = None

    def discard(self) -> None:
        """Delete the unfinished piece of the film."""
        if self._piece is not None:
            self._piece.discard()
            self._piece = None


def segments_in(folder: FilePath) -> list[Path]:
    """Complete pieces of a film in a folder, in order. Raises SourceError if there are none, or if one is missing."""
    paths = sorted(path for suffix in SUFFIX.values() for path in Path(folder).glob(f"[0-9]*{suffix}"))
    if not paths:
        raise SourceError(f"{folder}: expected pieces of a film, 000000.mkv or .avi, found none")
    for k, path in enumerate(paths):
        if path.stem != f"{k:06d}" or path.suffix != paths[0].suffix:
            raise SourceError(f"{folder}: expected piece {k:06d}{paths[0].suffix}, found {path.name}")
    return paths


def count_segment_frames(folder: FilePath) -> int:
    """Number of frames in all pieces, found by reading them. Raises SourceError if a piece is missing or unreadable."""
    return sum(count_frames(path) for path in segments_in(folder))


class SegmentFrames(Closing):
    """Frames of all pieces in order, each with its exposure time [s]. Frames after the last exposure time are omitted.

    Raises SourceError if pieces are missing or unreadable, or if there are fewer frames than exposure times.
    """

    def __init__(self, folder: FilePath, exposures_s: Sequence[float]) -> None:
        self.folder = Path(folder)
        self._exposures = [float(t) for t in exposures_s]
        self._paths = segments_in(self.folder)
        self._open: VideoFileFrames | None = None

    def __iter__(self) -> Iterator[Frame]:
        index = 0
        for path in self._paths:
            self._open = VideoFileFrames(path)
            for frame in self._open:
                if index == len(self._exposures):
                    return
                yield Frame(index, self._exposures[index], frame.image)
                index += 1
            self._open.close()
        if index < len(self._exposures):
            raise SourceError(f"{self.folder}: expected {len(self._exposures)} frames, found {index}")

    def close(self) -> None:
        """Close the piece of the film that is being read."""
        if self._open is not None:
            self._open.close()


def join_segments(
    folder: FilePath, film: FilePath, n_frames: int, fps: float, advance: Callable[[float], None] = lambda _share: None
) -> None:
    """Write the first n_frames frames of a folder's pieces as one film. The pixels do not change.

    advance: called after each frame with the share of frames written so far, 0 to 1
    Raises SourceError if pieces are missing or unreadable, if frames are missing, or if the film cannot be written.
    """
    paths = segments_in(folder)
    if paths[0].suffix == SUFFIX["FFV1"]:
        with (
            SegmentFrames(folder, [0.0] * n_frames) as frames,
            VideoWriter(film, _size_px(paths[0]), fps, codec="FFV1") as writer,
        ):
            for frame in frames:
                writer.write(frame.image)
                advance((frame.index + 1) / n_frames)
    else:
        _join_jpegs(paths, Path(film), n_frames, fps, advance)


def _join_jpegs(paths: list[Path], film: Path, n_frames: int, fps: float, advance: Callable[[float], None]) -> None:
    size_px = _size_px(paths[0])
    partial = film.with_name(f".{film.stem}.{os.getpid()}.partial{film.suffix}")
    raw = [cv2.VIDEOWRITER_PROP_RAW_VIDEO, 1]
    name = opencv_name(partial)
    with quiet_opencv():
        writer = cv2.VideoWriter(name, cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), fps, size_px, raw)
    try:
        if not writer.isOpened():
            raise SourceError(f"{film}: expected a path where a film can be written, found none")
        index = 0
        for path in paths:
            for packet in whole_packets(path):
                if index == n_frames:
                    break
                writer.set(cv2.VIDEOWRITER_PROP_PTS, index)
                writer.write(packet)
                index += 1
                advance(index / n_frames)
        writer.release()
        if index < n_frames:
            raise SourceError(f"{film}: expected {n_frames} frames in its pieces, found {index}")
        n_found = sum(1 for _ in whole_packets(partial))
        if n_found < n_frames:
            raise SourceError(f"{film}: expected room for {n_frames} frames, found it for {n_found}")
        os.replace(partial, film)
    finally:
        writer.release()
        partial.unlink(missing_ok=True)


def _size_px(path: Path) -> tuple[int, int]:
    with VideoFileFrames(path) as frames:
        image = next(iter(frames)).image
    return image.shape[1], image.shape[0]
