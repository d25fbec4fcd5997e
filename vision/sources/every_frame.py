"""Source of every frame of a file, as fast as the frames are requested."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from vision.sources.events import EventKind, SourceEvent
from vision.sources.frames import Closing, Frame


class FrameFile(Protocol):
    """Interface of a file that delivers its frames in order. The file is open until `close` is called."""

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames from the first one on."""

    def close(self) -> None:
        """Close the file."""


class EveryFrame(Closing):
    """Source of every frame of a file or folder, in order. It uses no thread and no clock."""

    frames_dropped = 0
    origin_s = 0.0
    """Value of `SourceOf.origin_s` [s]. It is 0, because the frames have the file's own times."""

    def __init__(self, frames: FrameFile) -> None:
        self._frames = frames
        self._coming = iter(frames)
        self._last: Frame | None = None
        self._events: list[SourceEvent] = []
        self._ended = False

    @property
    def ended(self) -> bool:
        """Whether all frames have been delivered."""
        return self._ended

    def next(self, timeout_s: float = 0.0) -> Frame | None:
        """The next frame; None after the last frame. Raises SourceError if the frame or its time cannot be read."""
        frame = None if self._ended else next(self._coming, None)
        if frame is None:
            if not self._ended:
                at_s = 0.0 if self._last is None else self._last.exposure_s
                self._events.append(SourceEvent(at_s, EventKind.ENDED, "after the last frame"))
            self._ended = True
            return None
        if self._last is not None and self._last.image.shape != frame.image.shape:
            (h0, w0), (h1, w1) = self._last.image.shape[:2], frame.image.shape[:2]
            self._events.append(SourceEvent(frame.exposure_s, EventKind.RESIZED, f"from {w0} x {h0} to {w1} x {h1} px"))
        self._last = frame
        return frame

    def __iter__(self) -> Iterator[Frame]:
        while (frame := self.next()) is not None:
            yield frame

    def take_events(self) -> tuple[SourceEvent, ...]:
        """The events since the last call, in order."""
        events, self._events = tuple(self._events), []
        return events

    def close(self) -> None:
        """Close the file. After this call, `next` returns None."""
        self._ended = True
        self._frames.close()
