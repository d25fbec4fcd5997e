"""Recording of frames as they arrive: what `softaim record` does.

The film is written in pieces that last a second, so that a recording remains if the program is killed. A complete piece
gets its final file name; then its rows are added to frames.csv. At the end the pieces are joined into one film.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import vision
from experiments.arrays import Floats
from experiments.errors import InputError, accepted, placed
from experiments.formats.films.pictures import FOLDERS, MARKS, SEGMENTS, VIDEOS, growing_in, source_in
from experiments.formats.outputs import check_apart, write_together
from experiments.formats.recording import read_frames, write_frames_csv
from experiments.formats.scene.scene import Scene, mesh_beside, write_scene
from experiments.pipeline.events import report_source_events
from experiments.pipeline.frame_sources import by_camera, check_size, open_each
from experiments.plain import counted

PIECE_S = 1.0
"""Duration of a piece [s]. If the program is killed, only the present piece is lost; the README promises one second."""

TABLES = ("frames.csv", MARKS, "truth.csv", "fixes.csv")
"""Files that are removed with the pictures when a recording is replaced."""

HEADER = b"frame,exposure_s\n"

Advance = Callable[[float], None]


@dataclass(slots=True)
class _Piece:
    """The present piece of a recording.

    first_row: number of the piece's first row in frames.csv; begins_at: position of this row in the file [bytes]
    began_s: clock time at which the piece began [s]; times_s: exposure times of the piece's frames [s]
    """

    first_row: int
    begins_at: int
    began_s: float = 0.0
    times_s: list[float] = field(default_factory=list)


class Recorder:
    """Writer of a recording that grows in pieces. Disk errors raise InputError.

    If Ctrl-C has interrupted a call, `finish_piece` can still complete the present piece, without duplicate frames.
    """

    def __init__(
        self,
        folder: Path,
        size_px: tuple[int, int],
        codec: vision.Codec = "FFV1",
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.folder, self.size_px, self._clock = folder, size_px, clock
        self._last_s = -float("inf")
        self._piece = _Piece(0, len(HEADER))
        self._fault: InputError | None = None
        with accepted(folder, "a folder that can be written"):
            (folder / SEGMENTS).mkdir(parents=True)
            with (folder / "frames.csv").open("xb") as rows:
                rows.write(HEADER)
        self._pieces = vision.SegmentWriter(folder / SEGMENTS, size_px, codec)

    @property
    def n_rows(self) -> int:
        """Number of rows of the finished pieces."""
        return self._piece.first_row

    def take(self, frame: vision.Frame) -> None:
        """Append a frame. Raises InputError if its size is not `self.size_px`, or its time is not after the last."""
        if self._fault is not None:
            raise self._fault
        height, width = frame.image.shape[:2]
        if (width, height) != self.size_px:
            expected = f"frames of {self.size_px[0]} x {self.size_px[1]} px"
            raise InputError.at(self.folder, expected, f"{width} x {height}")
        if not round(frame.exposure_s, 9) > round(self._last_s, 9):
            raise InputError.at(self.folder, f"a frame after {self._last_s:.9f} s", f"{frame.exposure_s:.9f} s")
        times = self._piece.times_s
        if times and frame.exposure_s - times[0] >= PIECE_S:
            self.finish_piece()
        self.check()  # checked here, too: frames may be written more slowly than they come
        if not self._piece.times_s:
            self._piece.began_s = self._clock()
        self._pieces.write(frame.image)
        self._piece.times_s.append(frame.exposure_s)
        self._last_s = frame.exposure_s

    def check(self) -> None:
        """Finish the present piece if it began at least `PIECE_S` seconds ago."""
        if self._piece.times_s and self._clock() - self._piece.began_s >= PIECE_S:
            self.finish_piece()

    def finish_piece(self) -> None:
        """Complete the present piece and sync it to the disk, then add its rows to frames.csv and sync this file.

        If this fails, for example because the disk is full, it raises InputError, and nothing more is recorded.
        """
        if self._fault is not None:
            raise self._fault
        piece = self._piece
        if not piece.times_s:
            self._pieces.discard()
            return
        rows_of = enumerate(piece.times_s, start=piece.first_row)
        lines = "".join(f"{k},{time_s:.9f}\n" for k, time_s in rows_of).encode("ascii")
        try:
            self._pieces.finish()
            with (self.folder / "frames.csv").open("r+b") as rows:
                rows.seek(piece.begins_at)
                rows.write(lines)
                rows.truncate()
                rows.flush()
                os.fsync(rows.fileno())
        except OSError as error:
            self._fault = InputError.refused(self.folder, "room to write", error)
            raise self._fault from error
        except vision.SourceError as error:
            self._fault = InputError(str(error))
            raise self._fault from error
        self._piece = _Piece(piece.first_row + len(piece.times_s), piece.begins_at + len(lines))


def record(
    sources: vision.Source | Mapping[str, vision.Source],
    folder: Path,
    *,
    scene: Scene | None = None,
    scene_path: Path | None = None,
    codec: vision.Codec = "FFV1",
    seconds: float = float("inf"),
    force: bool = False,
    clock: Callable[[], float] = time.monotonic,
) -> int:
    """Record frames to a new folder until Ctrl-C, the source's end, or `seconds` [s]; returns the number of frames.

    sources: the source of one camera, or the sources of several cameras by name
    scene: scene whose cameras state the size of the frames; scene_path: its file, which is copied to the folder
    force: whether the first frame removes an older recording in the folder
    Nothing is written before the first frame. Raises InputError, SourceError; the frames recorded so far are kept.
    """
    named = dict(sources) if isinstance(sources, Mapping) else {"": sources}
    recorders: dict[str, Recorder] = {}
    began, first_s, opening_s = clock(), 0.0, vision.SourceSettings().opening_s

    def begin(name: str, frame: vision.Frame) -> None:
        nonlocal first_s
        if scene is not None:
            check_size(frame, scene, name)
        if not recorders:
            first_s = frame.exposure_s
            if force:
                remove_recording(folder)
        height, width = frame.image.shape[:2]
        recorders[name] = Recorder(growing_in(folder, name), (width, height), codec, clock=clock)
        if len(recorders) == 1:
            _copy_scene(scene, scene_path, folder / "scene.toml")

    def goes_on(name: str, wait_s: float) -> bool:
        """Record the camera's next picture; returns whether its source continues."""
        frame = named[name].next(wait_s)
        report_source_events(named[name], name)
        if frame is None:
            if name in recorders:
                recorders[name].check()
            return not named[name].ended and clock() - began < (seconds if recorders else max(seconds, opening_s))
        if name not in recorders:
            begin(name, frame)
        elif frame.exposure_s - first_s >= seconds:
            return False
        recorders[name].take(frame)
        return True

    going = list(named)
    try:
        while going:
            going = [name for name in going if goes_on(name, 0.1 * PIECE_S / len(going))]
    except KeyboardInterrupt:
        pass  # Ctrl-C ends a recording
    finally:
        for name, frames in named.items():
            report_source_events(frames, name)
        for recorder in recorders.values():
            recorder.finish_piece()
    return sum(recorder.n_rows for recorder in recorders.values())


def remove_recording(folder: Path) -> None:
    """Remove a recording's files, except scene.toml, from a folder. Other files stay. Raises InputError."""
    of_cameras = [*_growing(folder), *(path for path in folder.glob("video.*.*") if f"video{path.suffix}" in VIDEOS)]
    of_cameras += [path for path in folder.glob("frames.*") if path.is_dir() or path.match("frames.*.csv")]
    with accepted(folder, "a folder that can be written"):
        for path in (*(folder / name for name in (*VIDEOS, *TABLES, *FOLDERS)), *of_cameras):
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)


def check_folder(out: Path, force: bool, read: Sequence[Path]) -> None:
    """Raise InputError if a recording cannot be written to a folder."""
    for path in read:
        check_apart(out, path)
    if out.exists() and not out.is_dir():
        raise InputError.at(out, "a new or empty folder", "a file")
    if out.is_dir() and any(out.iterdir()) and not force:
        raise InputError.at(out, "a new or empty folder", "files in it; --force replaces a recording in it")


def _copy_scene(scene: Scene | None, scene_path: Path | None, path: Path) -> None:
    if scene_path is not None:
        beside = {} if scene is None else mesh_beside(scene, path)
        write_together({**beside, path: scene_path.read_bytes()})
    elif scene is not None:
        write_scene(scene, path)


def rate_of(exposures_s: Floats) -> float:
    """Mean frame rate of a film [frames/s], from exposure times [s], (n_frames,); `NOMINAL_FPS` for a single frame."""
    span_s = float(exposures_s[-1] - exposures_s[0])
    return float(np.clip((len(exposures_s) - 1) / span_s, 1.0, 1000.0)) if span_s > 0.0 else vision.NOMINAL_FPS


def join(folder: Path, advance: Advance = lambda _share: None) -> int:
    """Join a recording's pieces into a film of each camera; returns the number of frames.

    Incomplete rows, and frames without a row, are dropped. If the program is killed during a call, the call can be
    repeated. Raises InputError if there are no pieces.
    """
    cameras = _growing(folder)
    if not cameras:
        return _join(folder, advance)
    n_frames, faults = 0, []
    for k, camera in enumerate(cameras):
        try:
            if (camera / SEGMENTS).is_dir():
                n_frames += _join(camera, lambda share, k=k: advance((k + share) / len(cameras)))  # type: ignore[misc]
            name = camera.name.removeprefix(f"{SEGMENTS}.")
            for film in camera.glob("video.*"):
                film.rename(folder / f"video.{name}{film.suffix}")
            (camera / "frames.csv").rename(folder / f"frames.{name}.csv")
            camera.rmdir()
        except InputError as error:
            faults.append(error)
        except OSError as error:
            raise InputError.refused(folder, "a folder that can be written", error) from error
    if faults:
        raise faults[0]
    return n_frames


def _growing(folder: Path) -> list[Path]:
    """The folder with the pieces of each camera; an empty list for a single camera, or if the pieces were joined."""
    return sorted(path.parent for path in folder.glob(f"{SEGMENTS}.*/frames.csv"))


def _join(folder: Path, advance: Advance) -> int:
    if not (folder / SEGMENTS).is_dir():
        raise InputError.at(folder, f"{SEGMENTS}/ of a killed recording", "none")
    exposures_s = read_frames(folder / "frames.csv", torn=True)
    n_frames = len(exposures_s)
    with placed("", vision.SourceError), accepted(folder, "a folder that can be written"):
        if source_in(folder).name not in VIDEOS:
            pieces = vision.segments_in(folder / SEGMENTS)
            film = folder / f"video{pieces[0].suffix}"
            write_frames_csv(folder / "frames.csv", exposures_s)
            vision.join_segments(folder / SEGMENTS, film, n_frames, rate_of(exposures_s), advance)
        shutil.rmtree(folder / SEGMENTS)
        for partial in folder.glob(".video.*.partial.*"):
            partial.unlink()
    return n_frames


def record_source(
    sources: Sequence[str],
    out: Path,
    scene_path: Path | None = None,
    *,
    codec: str = "FFV1",
    seconds: float | None = None,
    fps: float | None = None,
    stage: Callable[[str], Advance] = lambda _name: lambda _share: None,
    force: bool = False,
) -> tuple[int, int, bool]:
    """Record to the folder `out`, and join the pieces.

    sources: one source, or NAME=SOURCE for each of several cameras
    force: whether `out` may contain files; the first frame then removes an older recording in `out`
    Returns the number of recorded frames, the number of dropped frames, and whether there is a scene.
    If the source fails, the pieces recorded so far are joined, and InputError is raised.
    """
    if codec not in ("FFV1", "MJPG"):
        raise InputError.at("--codec", "FFV1 or MJPG", codec)
    check_folder(out, force, [path for path in map(Path, by_camera(sources).values()) if path.exists()])
    scene, frames = open_each(sources, scene_path, live=False, fps=fps)
    fault: Exception | None = None
    with ExitStack() as opened:
        for one in frames.values():
            opened.enter_context(one)
        try:
            record(
                frames,
                out,
                scene=scene,
                scene_path=scene_path,
                codec="FFV1" if codec == "FFV1" else "MJPG",
                seconds=float("inf") if seconds is None else seconds,
                force=force,
            )
        except (vision.SourceError, InputError) as error:
            fault = error
    n_frames = 0
    if (out / SEGMENTS).is_dir() or _growing(out):
        try:
            n_frames = join(out, stage("join"))
        except InputError as error:
            fault = fault or error
    elif fault is None:
        fault = InputError("expected frames, found none")
    if fault is not None:
        kept = f"; {counted(n_frames, 'frame')} until then in {out}" if n_frames else ""
        raise InputError(f"{', '.join(map(vision.shown_source, sources))}: {fault}{kept}")
    return n_frames, sum(one.frames_dropped for one in frames.values()), scene is not None
