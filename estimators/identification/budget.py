"""The time and processes that an estimation from a recording may take, and its errors."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

Workers = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
"""A map, such as a process pool's: function and arguments can be pickled."""

UNLIMITED = float("inf")
"""No limit of the time."""


class IdentificationError(ValueError):
    """A recording from which nothing can be estimated; the message gives the reason."""


def too_short(limit: Budget) -> IdentificationError:
    """The error for a time that is too short for any result."""
    return IdentificationError(
        f"expected more time, found {limit.seconds:.0f} s: too short to pass some frames through the filter"
    )


class OutOfTimeError(Exception):
    """The time that an estimation may take is over."""


class Progress:
    """The share of a search that is done, in frames that passes of the filter have seen.

    Frames are counted in this process. Those of passes in other processes count when these return.

    State: `seen`, frames counted; `returned`, frames of the passes that have returned.
    """

    def __init__(self, expected: float, advance: Callable[[float], None]) -> None:
        self.expected, self._advance = expected, advance
        self.seen = self.returned = 0.0

    def frame(self) -> None:
        """Count a frame."""
        self.seen += 1.0
        self._advance(self.seen / self.expected)

    def passes(self, n_frames: float) -> None:
        """Count passes that have returned, with so many frames together, unless they are counted."""
        self.returned += n_frames
        self.seen = max(self.seen, self.returned)
        self._advance(self.seen / self.expected)


class Budget:
    """A time limit in seconds from now on.

    State: when it began, by a clock that never goes back.
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
        """The same budget that also calls this at each check, but not in other processes."""
        some = self.part(1.0)
        some._on_check = on_check
        return some

    def part(self, share: float) -> Budget:
        """A budget of a share of the time, with the same start."""
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
