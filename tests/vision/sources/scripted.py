"""Captures that give a test's answers, clocks that the test moves, and numbered pictures."""

import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from vision import Frame, LiveFrames, VideoWriter


def numbered(k: int) -> np.ndarray:
    """A picture whose grey level is by its number."""
    return np.full((48, 64, 3), 20 * k + 10, dtype=np.uint8)


def numbers(frames: list[Frame]) -> list[int]:
    return [(int(frame.image[5, 5, 0]) - 10) // 20 for frame in frames]


def filmed(path: Path, pictures: Iterable[np.ndarray], fps: float = 25.0, **how: object) -> Path:
    """A film of pictures of 64 x 48 px."""
    with VideoWriter(path, (64, 48), fps, **how) as video:  # type: ignore[arg-type]
        for image in pictures:
            video.write(image)
    return path


class Clock:
    """A clock that stands until the test moves it."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class Ticking(Clock):
    """A clock that goes on by 0.01 s each time it is read."""

    STEP_S = 0.01

    def __call__(self) -> float:
        self.now += self.STEP_S
        return self.now


class Scripted:
    """A capture that gives the test's answers, each when it is let; None: a read that fails.

    Held: a read before which there is no answer yet, for ever if none comes.
    """

    def __init__(self, *answers: np.ndarray | str | Exception | None, opens: bool = True) -> None:
        self.answers, self.opens, self.released = list(answers), opens, threading.Event()
        self.let = threading.Semaphore(len(self.answers))
        self.given: object = None
        self.n_asked = self.n_given = 0

    @property
    def waits(self) -> bool:
        """Whether all answers have been taken and another is asked for: what came has been dealt with."""
        return not self.answers and self.n_asked > self.n_given

    def give(self, *answers: np.ndarray | str | Exception | None) -> None:
        for answer in answers:
            self.answers.append(answer)
            self.let.release()

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        return self.opens

    def grab(self) -> bool:
        self.n_asked += 1
        self.let.acquire()
        self.n_given += 1
        self.given = self.answers.pop(0) if self.answers else None
        if isinstance(self.given, Exception):
            raise self.given
        return self.given is not None

    def retrieve(self) -> tuple[bool, object]:
        return True, None if isinstance(self.given, str) else self.given

    def get(self, _prop: int) -> float:
        return 0.0

    def release(self) -> None:
        self.released.set()


class Let(LiveFrames):
    """Live frames whose captures come back from their reads when they are closed, so that no test waits for them."""

    captures: tuple[Scripted, ...] = ()

    def close(self) -> None:
        for capture in self.captures:
            capture.let.release()
        super().close()


def wait_until(condition: Callable[[], object], *, limit_s: float = 120.0) -> None:
    end = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.001)


def opened(*captures: Scripted, clock: Clock, **options: object) -> LiveFrames:
    """Frames of captures that are opened one after the other; pauses last a millisecond."""
    coming = list(captures)

    def open_next() -> Scripted:
        return coming.pop(0) if coming else Scripted(opens=False)

    live = Let(open_next, clock=clock, nap=lambda _s: time.sleep(0.001), **options)  # type: ignore[arg-type]
    live.captures = captures
    return live
