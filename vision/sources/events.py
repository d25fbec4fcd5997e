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
    """The same picture, bit for bit, or the same values, to the last digit, repeatedly."""
    DROPPED = "DROPPED"
    """A read that failed; the source is read again, then opened again."""
    SPARSE = "SPARSE"
    """At least half of the pictures are lost, or the source took half as many."""
    RESUMED = "RESUMED"
    """New pictures after one of these, or all of them again."""
    RESIZED = "RESIZED"
    """Pictures of another size than before."""
    REFUSED = "REFUSED"
    """What came could not be used: it is not a frame, or its time is out of order."""
    ASIDE = "ASIDE"
    """The first marks lie far from where they are expected, and in another unit or order would not."""
    CLOCK = "CLOCK"
    """Its own times stand still, go back or drift: times of arrival are used."""
    ENDED = "ENDED"
    """No frames will come any more."""


@dataclass(frozen=True, slots=True)
class SourceEvent:
    """An event of a source: when, by the clock of its exposure times [s], its kind, and a line of text."""

    time_s: float
    kind: EventKind
    text: str

    def __str__(self) -> str:
        return f"{self.kind} {self.text}"


class SourceOf(Protocol[F_co]):
    """A source of frames in order of exposure."""

    @property
    def frames_dropped(self) -> int:
        """Frames that were read and not delivered, because newer ones had come, or their time was wrong."""

    @property
    def origin_s(self) -> float:
        """Zero of the source's own time on the clock of its frames [s]; 0 if frames have the source's own time."""

    @property
    def ended(self) -> bool:
        """Whether all frames have been delivered and none will come."""

    def next(self, timeout_s: float) -> F_co | None:
        """The next frame, or None where there is none within timeout_s [s] or the source ended; SourceError."""

    def take_events(self) -> tuple[SourceEvent, ...]:
        """The events since the last call, in order."""

    def close(self) -> None:
        """Stop, and release the source."""

    def __enter__(self) -> Self:
        """The source, closed at the end of the block."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""


class Source(SourceOf[Frame], Protocol):
    """Pictures in order of exposure."""

    def __iter__(self) -> Iterator[Frame]:
        """Yield all frames until the source ends, waiting through its faults; raises SourceError."""
