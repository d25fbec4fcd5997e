"""Interface of a source of frames, and the events that it reports beside frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from types import TracebackType
from typing import Protocol, Self, TypeVar

from vision.sources.frames import Frame

F_co = TypeVar("F_co", covariant=True)


class EventKind(StrEnum):
    """What happened to a source."""

    BLOCKED = "BLOCKED"
    """No answer: a read that does not come back."""
    FROZEN = "FROZEN"
    """The same picture, bit for bit, or the same values, to the last digit, again and again."""
    DROPPED = "DROPPED"
    """A read that failed; the source is read again, then opened again."""
    SPARSE = "SPARSE"
    """Between the pictures that come as many as come are lost, or the source took half as many."""
    RESUMED = "RESUMED"
    """New pictures after one of these, or all of them again."""
    RESIZED = "RESIZED"
    """Pictures of another size than before."""
    REFUSED = "REFUSED"
    """What came could not be used: it is no frame, or its time does not follow."""
    ASIDE = "ASIDE"
    """Marks that came first lie far from where they are expected, and by another reading of them would not."""
    CLOCK = "CLOCK"
    """Its own times stand still, go back or wander: times of arrival are used."""
    ENDED = "ENDED"
    """No frames will come any more."""


@dataclass(frozen=True, slots=True)
class SourceEvent:
    """What happened to a source: when, by the clock of its exposure times [s], what, and a line for people."""

    time_s: float
    kind: EventKind
    text: str

    def __str__(self) -> str:
        return f"{self.kind} {self.text}"


class SourceOf(Protocol[F_co]):
    """Frames of some kind in order of exposure, whatever they come from.

    frames_dropped: frames that were read and not handed on, because newer ones had come, or their time was wrong
    """

    frames_dropped: int

    @property
    def origin_s(self) -> float:
        """When the source's own time was nought, on the clock of its frames [s]; 0 where they have its own time."""

    @property
    def ended(self) -> bool:
        """Whether all frames have been handed on and none will come."""

    def next(self, timeout_s: float) -> F_co | None:
        """The next frame, or None where there is none within timeout_s [s] or the source ended; SourceError."""

    def take_events(self) -> tuple[SourceEvent, ...]:
        """What happened since this was last asked, in order."""

    def close(self) -> None:
        """Stop, and let go of the source."""

    def __enter__(self) -> Self:
        """The source, closed at the end of the block."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""


class Source(SourceOf[Frame], Protocol):
    """Pictures in order of exposure."""

    def __iter__(self) -> Iterator[Frame]:
        """All frames until the source ends, waiting through its faults; SourceError."""
