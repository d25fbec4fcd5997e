"""Protocol of a source of frames, and the events that a source reports, such as faults."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from types import TracebackType
from typing import Protocol, Self, TypeVar

from vision.sources.frames import Frame

F_co = TypeVar("F_co", covariant=True)


class EventKind(StrEnum):
    """Kind of event of a source."""

    BLOCKED = "BLOCKED"
    """A read does not return."""
    FROZEN = "FROZEN"
    """A picture repeats bit for bit, or values repeat to the last digit."""
    DROPPED = "DROPPED"
    """A read failed. The source is read again, and then reopened."""
    SPARSE = "SPARSE"
    """At most half of the usual number of pictures arrives."""
    RESUMED = "RESUMED"
    """New pictures come after a fault, or no more pictures are lost."""
    RESIZED = "RESIZED"
    """The size of the pictures has changed."""
    REFUSED = "REFUSED"
    """An input is not a frame, or its time is not in order."""
    ASIDE = "ASIDE"
    """The first observed marks are far from their expected positions, but would be near with other units or axes."""
    CLOCK = "CLOCK"
    """The source's own times stand still, go back or drift. Arrival times are used in their place."""
    ENDED = "ENDED"
    """No more frames will come."""


@dataclass(frozen=True, slots=True)
class SourceEvent:
    """An event of a source: time [s], kind, and one line of text. The time is on the same clock as exposure times."""

    time_s: float
    kind: EventKind
    text: str

    def __str__(self) -> str:
        return f"{self.kind} {self.text}"


class SourceOf(Protocol[F_co]):
    """Protocol of a source that delivers frames, or sets of simultaneous frames, in the order of their exposure."""

    @property
    def frames_dropped(self) -> int:
        """Number of frames that were read but dropped: a newer frame came, or their exposure time did not increase."""

    @property
    def origin_s(self) -> float:
        """Clock time at which time 0 of a recording is played [s]; 0 for a source that plays no recording."""

    @property
    def ended(self) -> bool:
        """Whether all frames have been delivered and no more will come."""

    def next(self, timeout_s: float) -> F_co | None:
        """The next frame; None at the end, or after timeout_s [s]. Raises SourceError if the source fails."""

    def take_events(self) -> tuple[SourceEvent, ...]:
        """The events since the last call, in order."""

    def close(self) -> None:
        """Stop, and release the source."""

    def __enter__(self) -> Self:
        """Return the source, which is closed at the end of the block."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the source."""


class Source(SourceOf[Frame], Protocol):
    """Protocol of a source that delivers single frames, in the order of their exposure."""

    def __iter__(self) -> Iterator[Frame]:
        """Yield frames until the source ends, also after faults. Raises SourceError if the source fails."""
