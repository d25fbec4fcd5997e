"""A recorder that is interrupted at any line, or whose disk is full: pieces are there once, whole, with their rows."""

import os
import shutil
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

import numpy as np
import pytest

import vision.sources.segments
import vision.sources.video
from experiments.errors import InputError
from experiments.formats.recording import read_frames
from experiments.pipeline import recorder as of_recorder
from experiments.pipeline.recorder import Recorder, join, record
from tests.experiments.pipeline.test_recorder import SIZE, Frames, noise, picture
from vision import Codec, EveryFrame, SegmentFrames, SourceError, VideoWriter, count_frames

FILES = tuple(module.__file__ for module in (of_recorder, vision.sources.segments, vision.sources.video))


class Interrupt:
    """Ctrl-C before the n-th line that is run in the files above; State: how many were run."""

    def __init__(self, n: int) -> None:
        self.n, self.count = n, 0

    def __call__(self, frame: FrameType, event: str, _argument: object) -> "Interrupt | None":
        if frame.f_code.co_filename not in FILES:
            return None
        if event == "line":
            self.count += 1
            if self.count == self.n:
                sys.settrace(None)
                raise KeyboardInterrupt
        return self


def recorded(folder: Path, interrupted_at: int) -> int:
    """Two pieces of 3 frames, the first finished under an interrupt, and again; how many lines that ran."""
    taken = Recorder(folder, SIZE, clock=lambda: 0.0)
    for frame in noise(3):
        taken.take(frame)
    interrupt, before = Interrupt(interrupted_at), sys.gettrace()
    sys.settrace(interrupt)
    try:
        taken.finish_piece()
    except KeyboardInterrupt:
        pass
    finally:
        sys.settrace(before)
    taken.finish_piece()
    for frame in noise(6)[3:]:
        taken.take(frame)
    taken.finish_piece()
    return interrupt.count


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # files are left open by some lines
def test_a_piece_finished_under_ctrl_c_at_any_line_is_there_once(tmp_path: Path) -> None:
    """At each line that finishing runs: all frames, bit for bit, their rows once, and nothing else."""
    n_lines = recorded(tmp_path / "whole", 0)
    assert n_lines > 20
    for at in range(1, n_lines + 1):
        folder = tmp_path / str(at)
        assert recorded(folder, at) <= n_lines
        assert sorted(path.name for path in (folder / "segments").iterdir()) == ["000000.mkv", "000001.mkv"], at
        times = read_frames(folder / "frames.csv")
        assert times == pytest.approx([frame.exposure_s for frame in noise(6)])
        with SegmentFrames(folder / "segments", times) as frames:
            for frame in frames:
                np.testing.assert_array_equal(frame.image, picture(frame.index))
        shutil.rmtree(folder)


def test_ctrl_c_while_a_second_ends_keeps_what_came(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """During the first fsync of the first piece: the recording ends with all frames until then, and joins."""
    fsync, asked = os.fsync, []

    def interrupted(handle: int) -> None:
        asked.append(handle)
        if len(asked) == 1:
            raise KeyboardInterrupt
        fsync(handle)

    monkeypatch.setattr(os, "fsync", interrupted)
    assert record(EveryFrame(Frames(*noise(50))), tmp_path / "rec", clock=lambda: 0.0) == 30
    assert join(tmp_path / "rec") == 30
    assert count_frames(tmp_path / "rec" / "video.mkv") == 30


def test_a_piece_without_frames_gets_no_name(tmp_path: Path) -> None:
    """Interrupted between opening the piece and its first frame."""
    taken = Recorder(tmp_path / "rec", SIZE)
    taken._pieces.write(picture(0))
    taken.finish_piece()
    assert list((tmp_path / "rec" / "segments").iterdir()) == []


@pytest.mark.parametrize("codec", ["FFV1", "MJPG"])
def test_a_film_cut_short_anywhere_is_not_named(tmp_path: Path, codec: Codec) -> None:
    """Cut at 16 places: where it still gets its name every frame of it is decoded."""
    suffix = {"FFV1": ".mkv", "MJPG": ".avi"}[codec]
    with VideoWriter(tmp_path / f"whole{suffix}", SIZE, 30.0, codec) as film:
        for k in range(5):
            film.write(picture(k))
    data = (tmp_path / f"whole{suffix}").read_bytes()
    n_named = 0
    for k, size in enumerate(np.linspace(0, len(data), 16).astype(int)):
        path = tmp_path / f"{k}{suffix}"
        film = VideoWriter(path, SIZE, 30.0, codec)
        for number in range(5):
            film.write(picture(number))
        film._writer.release()
        os.truncate(film._partial, size)
        with suppress(SourceError):
            film.close()
        n_named += path.exists()
        assert not path.exists() or count_frames(path) == 5
    assert 1 <= n_named < 8
    assert not list(tmp_path.glob(".*"))


@contextmanager
def room(n_bytes: int) -> Iterator[None]:
    """No file grows beyond this meanwhile: a write fails, as on a full disk."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ended = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ended)


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on the size of files there")
@pytest.mark.parametrize(("codec", "n_bytes"), [("FFV1", 60_000), ("MJPG", 700)])
def test_where_a_file_cannot_grow_no_piece_is_named_that_cannot_be_decoded(tmp_path, codec, n_bytes):
    """An error in one line, and no piece, for the first one does not fit."""
    folder = tmp_path / "rec"
    with room(n_bytes), pytest.raises(InputError) as error:
        record(EveryFrame(Frames(*noise(40))), folder, codec=codec, clock=lambda: 0.0)
    (line,) = str(error.value).splitlines()
    assert "expected room" in line
    assert str(folder) in line
    assert list((folder / "segments").iterdir()) == []
    assert (folder / "frames.csv").read_bytes() == b"frame,exposure_s\n"
