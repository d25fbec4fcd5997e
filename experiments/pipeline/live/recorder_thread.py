"""A thread that records, so that the loop does not wait for drawing and compression."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Generic, TypeVar

import vision
from experiments.pipeline.recorder import PIECE_S, Recorder

Item = TypeVar("Item")

Faults = type[Exception] | tuple[type[Exception], ...]


class RecorderThread(Generic[Item]):
    """Thread that records items in order until `finish`.

    folder, codec: arguments of the `Recorder`; frame: converts an item to a frame, called in the thread
    n_waiting: largest number of waiting items
    faults: types of errors that end the recording; failed: called in the thread with the error that occurred
    """

    def __init__(
        self,
        folder: Path,
        codec: vision.Codec,
        frame: Callable[[Item], vision.Frame],
        *,
        n_waiting: int,
        faults: Faults,
        failed: Callable[[Exception], None],
    ) -> None:
        self._folder, self._codec, self._frame = folder, codec, frame
        self._n_waiting, self._faults, self._failed = n_waiting, faults, failed
        self._waiting: deque[Item] = deque()
        self._changed = threading.Condition()
        self._recorder: Recorder | None = None
        self.n_recorded = 0
        self.ends = False
        self._thread = threading.Thread(target=self._work, name=folder.name, daemon=True)
        self._thread.start()

    def put(self, item: Item) -> bool:
        """Pass an item to the thread and return True; if too many items already wait, only return False."""
        with self._changed:
            if len(self._waiting) >= self._n_waiting:
                return False
            self._waiting.append(item)
            self._changed.notify()
        return True

    def make_room(self) -> bool:
        """If the largest number of items already waits, drop the oldest; returns whether an item was dropped."""
        with self._changed:
            full = len(self._waiting) >= self._n_waiting
            if full:
                self._waiting.popleft()
        return full

    def finish(self) -> None:
        """Record the waiting items and end."""
        with self._changed:
            self.ends = True
            self._changed.notify()
        self._thread.join()

    def _work(self) -> None:
        try:
            while not self.ends or self._waiting:  # `_waiting` is tested last: no item is added after `ends`
                item = self._next()
                if item is not None:
                    self._record(self._frame(item))
                elif self._recorder is not None:
                    self._recorder.check()
            if self._recorder is not None:
                self._recorder.finish_piece()
        except self._faults as fault:
            self._failed(fault)

    def _next(self) -> Item | None:
        with self._changed:
            if not self._waiting and not self.ends:
                self._changed.wait(0.1 * PIECE_S)
            return self._waiting.popleft() if self._waiting else None

    def _record(self, frame: vision.Frame) -> None:
        if self._recorder is None:
            height, width = frame.image.shape[:2]
            self._recorder = Recorder(self._folder, (width, height), self._codec)
        self._recorder.take(frame)
        self.n_recorded += 1
