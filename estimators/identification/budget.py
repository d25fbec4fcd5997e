"""The time and processes that an estimation from a recording may take, and what is raised where nothing comes of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

Workers = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
"""A map, such as that of a pool of processes: function and arguments can be pickled."""

UNLIMITED = float("inf")
"""As many seconds as it takes."""


class IdentificationError(ValueError):
    """A recording from which nothing can be estimated; the message gives the reason."""


def too_short(limit: Budget) -> IdentificationError:
    """The error of a time that is not enough for anything."""
    return IdentificationError(
        f"expected more time, found {limit.seconds:.0f} s: too short to pass some frames through the filter"
    )


class OutOfTimeError(Exception):
    """The time that an estimation may take is over."""


class Budget:
    """Seconds that may be spent from now on.

    State: when it began, by a clock that never goes back.
    """

    def __init__(self, seconds: float = UNLIMITED, clock: Callable[[], float] = time.monotonic) -> None:
        if not seconds > 0.0:
            raise ValueError(f"seconds: expected more than 0, found {seconds}")
        self.seconds = seconds
        self._clock = clock
        self._began = clock()

    def part(self, share: float) -> Budget:
        """A budget of a share of the time, begun when the whole was."""
        some = Budget(share * self.seconds, self._clock)
        some._began = self._began
        return some

    @property
    def spent_s(self) -> float:
        """Seconds gone."""
        return self._clock() - self._began

    @property
    def share(self) -> float:
        """Part of it that is gone, at most 1."""
        return min(1.0, self.spent_s / self.seconds)

    def check(self) -> None:
        """Raise OutOfTimeError where it is over."""
        if self.spent_s > self.seconds:
            raise OutOfTimeError
