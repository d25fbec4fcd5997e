"""Live marks from another tracker, read in a thread; a newer frame replaces the frame that waits."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from estimators import MarkMeasurement
from experiments.errors import InputError
from experiments.formats.marks.drawing import FirstMarks, of_another_size
from experiments.formats.marks.rows import values_of
from experiments.formats.scene.scene import Scene
from experiments.pipeline.live.marks.lines import SentFrame, read_line
from experiments.pipeline.live.marks.sender_clock import OrderError, SenderClock
from experiments.pipeline.track import measurement
from vision import (
    Closing,
    EventKind,
    FrozenValues,
    SourceError,
    SourceEvent,
    SourceOf,
    SourceSettings,
    SourceWatchdog,
)

SETTINGS = SourceSettings()
"""Thresholds for a blocked sender and for jumps of the sender's clock, equal to those for a camera."""


@dataclass(frozen=True, slots=True, eq=False)
class MarksFrame:
    """A frame with any number of marks, even none; index: from 0; exposure_s: exposure by the monotonic clock [s]."""

    index: int
    exposure_s: float
    marks: tuple[MarkMeasurement, ...]


MarkSource = SourceOf[MarksFrame]
"""A source of frames of marks, like `vision.Source` for pictures."""


class Feed(Protocol):
    """Interface of an input of marks, such as a socket or a pipe."""

    def run(self, receiver: LiveMarks) -> None:
        """Deliver all input, until the receiver is closed or the input ends; called in the reading thread.

        Calls `take_line` or `take`, and `refuse` for unusable input. Raises OSError if the feed fails.
        """

    def close(self) -> None:
        """Release the transport."""


class LiveMarks(Closing):
    """Source of the newest frame of marks from a feed. The source ends when the feed ends or at `close()`.

    No frame is delivered twice. Invalid lines and frames with times out of order are refused. Refused input is counted
    by kind. The first refusal is immediately reported as an event; later refusals are reported together, at most once
    in SETTINGS.hung_s. If no usable frame comes for SETTINGS.blocked_s, there is an event BLOCKED. A frame that repeats
    earlier values is omitted; after the event FROZEN, such a frame is delivered without marks.
    refused: counts of unusable input, by kind
    """

    origin_s = 0.0
    """Zero of the source's time [s]: the sender's times are converted to the clock of this machine."""

    def __init__(self, scene: Scene, feed: Feed, *, clock: Callable[[], float] = time.monotonic) -> None:
        self.clock = clock
        self.frames_dropped = 0
        self.refused: Counter[str] = Counter()
        self._scene, self._feed = scene, feed
        self._changed = threading.Condition()
        self._stop = threading.Event()
        self._sender = SenderClock(SETTINGS)
        self._watch, self._frozen = SourceWatchdog(clock(), SETTINGS), FrozenValues(SETTINGS)
        self._first = FirstMarks(scene)
        self._waiting: MarksFrame | None = None
        self._n_frames = 0
        self._events: list[SourceEvent] = []
        self._unreported: dict[str, tuple[int, str]] = {}
        self._reported_s = -float("inf")
        self._error: Exception | None = None
        self._finished = self._ended = False
        # A daemon thread: a pipe may block forever, but the program must still end.
        self._thread = threading.Thread(target=self._run, name="softaim marks", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._feed.run(self)
        except Exception as error:
            self._error = error
        with self._changed:
            self._finished = True
            self._changed.notify_all()

    @property
    def wanted(self) -> bool:
        """Whether the feed should continue; the feed checks this regularly."""
        return not self._stop.is_set()

    def take_line(self, line: bytes) -> None:
        """Process a line that has just arrived; an empty one is ignored."""
        arrival_s = self.clock()
        if not line.strip():
            return
        try:
            self.take(read_line(line, self._scene), arrival_s)
        except InputError as error:
            self.refuse("malformed", str(error))

    def take(self, frame: SentFrame, arrival_s: float) -> None:
        """Process a frame that arrived at the time arrival_s [s] of this machine's clock."""
        with self._changed:
            restarts = self._sender.restarts
            try:
                exposure_s = self._sender.exposure_s(frame.time_s, arrival_s)
            except OrderError as error:
                self.refuse("out of order", str(error))
                return
            if self._sender.restarts > restarts:
                text = f"the sender's clock was set to {frame.time_s:.3f} s"
                self._events.append(SourceEvent(arrival_s, EventKind.RESUMED, text))
            self._events += self._watch.saw_new(arrival_s, (0, 0))
            self._report()
            places = {mark.node: mark.position_m for mark in frame.marks}
            line = self._first.take(places)
            if line is not None:
                self._events.append(SourceEvent(arrival_s, EventKind.ASIDE, line))
            if (size := of_another_size(self._scene, places)) is not None:
                self.refuse("of another size", size)
                return
            repeats, events = self._frozen.saw(exposure_s, values_of(frame.marks))
            self._events += events
            if repeats and not self._frozen.frozen:
                return
            self.frames_dropped += self._waiting is not None
            marks = () if repeats else tuple(measurement(mark) for mark in frame.marks)
            self._waiting = MarksFrame(self._n_frames, exposure_s, marks)
            self._n_frames += 1
            self._changed.notify_all()

    def refuse(self, kind: str, text: str) -> None:
        """Count unusable input of this kind; text: message with what was expected and found."""
        with self._changed:
            self.refused[kind] += 1
            n, first = self._unreported.get(kind, (0, text))
            self._unreported[kind] = n + 1, first
            self._report()

    def _report(self) -> None:
        """If it is time to report refused input, add an event with the count and the first message of each kind."""
        now = self.clock()
        if not self._unreported or now - self._reported_s < SETTINGS.hung_s:
            return
        self._reported_s = now
        counts = [f"{n} {kind}{', first' if n > 1 else ''}: {text}" for kind, (n, text) in self._unreported.items()]
        self._events.append(SourceEvent(now, EventKind.REFUSED, "; ".join(counts)))
        self._unreported.clear()
        self._changed.notify_all()

    @property
    def ended(self) -> bool:
        """Whether no further frame will come."""
        return self._ended or self._stop.is_set()

    def next(self, timeout_s: float) -> MarksFrame | None:
        """The newest frame not yet delivered; None at the end, or if none comes within timeout_s [s].

        Raises SourceError if the feed fails. Also raises any other exception of the reading thread.
        """
        until = self.clock() + timeout_s
        with self._changed:
            while not self.ended:
                now = self.clock()
                if self._waiting is not None:
                    frame, self._waiting = self._waiting, None
                    return frame
                if self._error is not None:
                    self._ended = True
                    if isinstance(self._error, OSError):
                        text = self._error.strerror or type(self._error).__name__
                        raise SourceError(f"expected lines of marks, found {text.lower()}") from self._error
                    raise self._error
                if self._finished:
                    self._ended = True
                    self._events.append(SourceEvent(now, EventKind.ENDED, "after the last frame"))
                    return None
                self._events += self._watch.check(now)
                if now >= until:
                    return None
                self._changed.wait(until - now)
        return None

    def take_events(self) -> tuple[SourceEvent, ...]:
        """The events since the last call, in order."""
        with self._changed:
            if not (self.ended or self._finished):
                self._events += self._watch.check(self.clock())
            events, self._events = tuple(self._events), []
        return events

    def close(self) -> None:
        """Stop the source; its thread ends after the read that is in progress."""
        self._stop.set()
        with self._changed:
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._finished, timeout=SETTINGS.blocked_s)
        self._feed.close()
