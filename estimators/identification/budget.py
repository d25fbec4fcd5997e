"""Time limit, progress and exceptions of an estimation from a recording."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

Workers = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
"""Function like `map`, for example the map function of a process pool. A process pool needs picklable arguments."""

UNLIMITED = float("inf")
"""Time limit that is never reached."""


class IdentificationError(ValueError):
    """Error for a recording from which nothing can be estimated. The message gives the reason."""


class TooShortError(IdentificationError):
    """Error for a time limit that is too short for any result."""

    def __init__(self, limit: Budget) -> None:
        found = f"found {limit.seconds:.0f} s: too short to pass some frames through the filter"
        super().__init__(f"expected more time, {found}")


class OutOfTimeError(Exception):
    """Error for an estimation that exceeded its time limit."""


class Progress:
    """Completed share of a search: number of processed frames, divided by the expected number.

    Passes in this process are counted frame by frame. A pass in a worker process is counted after it has returned.

    State: `seen`, number of processed frames; `returned`, number of frames of the passes that have returned.
    """

    def __init__(self, expected: float, advance: Callable[[float], None]) -> None:
        self.expected, self._advance = expected, advance
        self.seen = self.returned = 0.0

    def frame(self) -> None:
        """Count one processed frame."""
        self.seen += 1.0
        self._advance(self.seen / self.expected)

    def passes(self, n_frames: float) -> None:
        """Count the frames of completed filter passes. Frames that `frame` has counted are not counted again."""
        self.returned += n_frames
        self.seen = max(self.seen, self.returned)
        self._advance(self.seen / self.expected)


class Budget:
    """A time limit that begins at construction.

    State: start time on a monotonic clock.
    """

    def __init__(self, seconds: float = UNLIMITED, clock: Callable[[], float] = time.monotonic) -> None:
        if not seconds > 0.0:
            raise ValueError(f"seconds: expected more than 0, found {seconds}")
        self.seconds = seconds
        self._clock = clock
        self._began = clock()
        self._on_check: Callable[[], None] | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_on_check": None}

    def watched(self, on_check: Callable[[], None]) -> Budget:
        """A budget with the same start and limit. Its `check` also calls `on_check`, except in a worker process."""
        some = self.part(1.0)
        some._on_check = on_check
        return some

    def part(self, share: float) -> Budget:
        """A budget with the same start and a share of this budget's time."""
        some = Budget(share * self.seconds, self._clock)
        some._began = self._began
        return some

    @property
    def spent_s(self) -> float:
        """Elapsed seconds."""
        return self._clock() - self._began

    @property
    def share(self) -> float:
        """Elapsed share of the time, at most 1."""
        return min(1.0, self.spent_s / self.seconds)

    def check(self) -> None:
        """Raise OutOfTimeError if the time is over."""
        if self._on_check is not None:
            self._on_check()
        if self.spent_s > self.seconds:
            raise OutOfTimeError
