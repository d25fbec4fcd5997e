"""Frames that a thread records: in order, no more waiting than may, and none lost at the end."""

import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np

from experiments.errors import InputError
from experiments.pipeline.live.recorder_thread import RecorderThread
from experiments.pipeline.recorder import join
from vision import Frame, VideoFileFrames


def shade(k: int) -> Frame:
    """A picture that is as bright as its number."""
    return Frame(k, 1.0 + k / 30.0, np.full((16, 16, 3), k, np.uint8))


def begun(folder: Path, frame: Callable[[int], Frame] = shade) -> tuple[RecorderThread[int], list[Exception]]:
    """A thread for which four may wait, and what it says of faults."""
    faults: list[Exception] = []
    one = RecorderThread(folder, "FFV1", frame, n_waiting=4, faults=InputError, failed=faults.append)
    return one, faults


def recorded(folder: Path) -> list[int]:
    """How bright the frames of the film are."""
    join(folder)
    with VideoFileFrames(folder / "video.mkv") as frames:
        return [int(frame.image[0, 0, 0]) for frame in frames]


class Slow:
    """Makes frames only when it may. State: whether it is at one, and whether it may go on."""

    def __init__(self) -> None:
        self.at, self.may = threading.Event(), threading.Event()

    def __call__(self, k: int) -> Frame:
        self.at.set()
        assert self.may.wait(60.0)
        return shade(k)


def test_room_is_made_where_there_is_none(tmp_path) -> None:
    slow = Slow()
    one, faults = begun(tmp_path / "r", slow)
    assert one.put(0)
    assert slow.at.wait(60.0)
    made = []
    for k in range(1, 7):
        made.append(one.make_room())
        assert one.put(k)
    assert made == [False] * 4 + [True] * 2
    slow.may.set()
    one.finish()
    assert faults == []
    assert recorded(tmp_path / "r") == [0, 3, 4, 5, 6]


def test_what_comes_just_before_the_end_is_recorded(tmp_path, monkeypatch) -> None:
    """Put, and the end asked for, after the thread found nothing and before it asks whether that was all."""
    idle, find = threading.Event(), RecorderThread._next

    def found(thread: RecorderThread[int]) -> int | None:
        item = find(thread)
        while item is None and not thread.ends:
            idle.set()
            threading.Event().wait(1e-3)
        return item

    monkeypatch.setattr(RecorderThread, "_next", found)
    one, faults = begun(tmp_path / "r")
    assert idle.wait(60.0)
    assert one.put(7)
    one.finish()
    assert (one.n_recorded, faults) == (1, [])
