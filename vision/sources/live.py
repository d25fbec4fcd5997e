"""Live frames: a thread reads a camera or stream, delivers its newest frame, and reopens the source after faults."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import cv2
import numpy as np

from vision.arrays import Image
from vision.sources.events import EventKind, SourceEvent
from vision.sources.exposure_times import Arrivals, DeviceTimes, ExposureRule, RisingTimes
from vision.sources.frames import Closing, Frame, SourceError, bgr, quiet_opencv
from vision.sources.settings import DEFAULTS, SourceSettings
from vision.sources.watchdog import IN_TURN, SourceWatchdog, SparsePictures

POLL_S = 0.02
"""Interval between tests for faults, and between attempts after failed reads [s]; choice: less than a frame interval
at 30 frames/s. New frames are delivered without this delay."""


class Capture(Protocol):
    """Protocol of a capture, such as cv2.VideoCapture."""

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        """Whether the device is open."""

    def grab(self) -> bool:
        """Wait for the next frame; returns False if there is none."""

    def retrieve(self) -> tuple[bool, Any]:
        """Whether the last call of `grab` was successful, and the frame of this call."""

    def get(self, prop: int) -> float:
        """Value of the property with this OpenCV number, such as cv2.CAP_PROP_FPS."""

    def release(self) -> None:
        """Release the device."""


@dataclass(slots=True, eq=False)
class Reader:
    """State of a reading thread.

    alive_s: time of last progress [s]; may_hang_s: longest time without progress [s]; retired: whether it was replaced
    """

    alive_s: float
    may_hang_s: float
    retired: bool = False


class LiveFrames(Closing):
    """Source of the newest frames of a camera or stream. Each frame is delivered at most once.

    open_capture: function that opens the source. A reading thread calls it, because a dead device may block the call.
    ends: function that returns whether a failed read is the end of the source. Otherwise, a failed read is a fault.
    keep: largest number of frames that wait for delivery; if there are more, the oldest frame is dropped
    exposures: function that returns a new rule for exposure times at each opening; default: `DeviceTimes`
    may_repeat: whether a picture that equals an earlier picture is delivered, as in a film; if not, it is dropped
    give_up_s: time without a frame after which SourceError is raised [s]; None: never
    settings: thresholds for faults
    clock: the monotonic clock [s]; nap: function that sleeps for a time [s]; default: a sleep that `close` ends
    origin: function that returns the clock time at which time 0 of a film is played [s]; default: 0
    waits: whether reading begins with the first call of `next`, as for a film; if not, it begins in the constructor

    If the source cannot be opened at first, `next` raises SourceError. If the source fails later, it is reopened.
    """

    def __init__(
        self,
        open_capture: Callable[[], Any],
        *,
        ends: Callable[[Any], bool] = lambda _capture: False,
        keep: int = 1,
        exposures: Callable[[], ExposureRule] | None = None,
        may_repeat: bool = False,
        give_up_s: float | None = None,
        settings: SourceSettings = DEFAULTS,
        clock: Callable[[], float] = time.monotonic,
        nap: Callable[[float], object] | None = None,
        origin: Callable[[], float] = lambda: 0.0,
        waits: bool = False,
    ) -> None:
        for name, value in (("give_up_s", give_up_s), ("keep", keep)):
            if value is not None and not value > 0:
                raise ValueError(f"{name}: expected more than 0, found {value}")
        self._open, self._ends, self._clock = open_capture, ends, clock
        self._exposures = partial(DeviceTimes, settings) if exposures is None else exposures
        self._may_repeat, self._give_up_s, self._settings = may_repeat, give_up_s, settings
        self._changed = threading.Condition()
        self._stop = threading.Event()
        self._nap = self._stop.wait if nap is None else nap
        self._waiting: deque[Frame] = deque()
        self._keep = keep
        self._last_s = -np.inf
        self._recent: deque[Image] = deque(maxlen=IN_TURN)
        self._n_frames = 0
        self._events: list[SourceEvent] = []
        self._opened = self._finished = self._ended = False
        self._error: Exception | None = None
        self.frames_dropped = 0
        self._watch = SourceWatchdog(clock(), settings, may_repeat=may_repeat)
        self._arrivals = Arrivals(settings)
        self._sparse = SparsePictures(settings)
        self._late_s = 0.0
        self._readers: list[Reader] = []
        self._reader: Reader | None = None
        self._origin = origin
        self.waits = waits
        if not waits:
            self._start_reader(clock())

    @property
    def origin_s(self) -> float:
        """Clock time at which time 0 of a film is played [s]; 0 for a camera or stream.

        Before the first frame of a film, it is the present.
        """
        return self._origin()

    @property
    def ended(self) -> bool:
        """Whether no further frame will come."""
        return self._ended or self._stop.is_set()

    @property
    def opening(self) -> bool:
        """Whether the source is being opened for the first time. Some cameras need ten seconds."""
        return not (self._opened or self._finished or self.ended or self._error is not None)

    @property
    def late_s(self) -> float:
        """Largest possible error of the last picture's exposure time after a pause [s]. The picture may be older."""
        return max(self._arrivals.late_s, self._late_s)

    @property
    def uneven(self) -> bool:
        """Whether pictures arrive so irregularly that their exposure times are unknown."""
        return self._arrivals.uneven(self._clock())

    @property
    def interval_s(self) -> float:
        """Median interval between the arrivals of frames [s]; 0 before the second frame."""
        return self._watch.interval_s

    def next(self, timeout_s: float) -> Frame | None:
        """The oldest waiting frame; None at the end, or if no frame comes within timeout_s [s].

        Raises SourceError if the source cannot be opened, or if no new frame comes for the time give_up_s of the
        constructor. Also raises the exceptions of the reading thread.
        """
        until = self._clock() + timeout_s
        with self._changed:
            if self.waits:
                self.waits = False
                self._watch.begin(self._clock())
                self._start_reader(self._clock())
            while not self.ended:
                now = self._clock()
                if self._waiting:
                    return self._waiting.popleft()
                if self._error is not None:
                    self._ended = True
                    raise self._error
                if self._finished:
                    self._ended = True
                    self._events.append(SourceEvent(now, EventKind.ENDED, "after the last frame"))
                    return None
                self._check(now)
                if now >= until:
                    return None
                self._changed.wait(min(until - now, POLL_S))
        return None

    def _check(self, now: float) -> None:
        self._events += self._watch.check(now)
        without_s = now - self._watch.new_s
        if self._give_up_s is not None and without_s > self._give_up_s:
            self._ended = True
            self._stop.set()
            raise SourceError(f"live frames: expected a new frame within {self._give_up_s:g} s, found none")
        hung = [now - reader.alive_s > reader.may_hang_s for reader in self._readers]
        if all(hung) and len(hung) < self._settings.most_readers:
            self._start_reader(now)

    def __iter__(self) -> Iterator[Frame]:
        while not self.ended:
            frame = self.next(1.0)
            if frame is not None:
                yield frame

    def take_events(self) -> tuple[SourceEvent, ...]:
        """The events since the last call, in order. Only calls of `next` detect a blocked or frozen source."""
        with self._changed:
            events, self._events = tuple(self._events), []
        return events

    def _start_reader(self, now: float) -> None:
        reader = Reader(now, self._settings.opening_s)
        self._readers.append(reader)
        # A daemon thread: a device may block grab() forever (OpenCV #4468), but the program must still end.
        threading.Thread(target=self._run, args=(reader,), name="softaim frames", daemon=True).start()

    def _run(self, reader: Reader) -> None:
        try:
            self._open_and_read(reader)
        except Exception as error:
            if self._wanted(reader):
                self._error = error
        with self._changed:
            self._readers.remove(reader)
            self._changed.notify_all()

    def _wanted(self, reader: Reader) -> bool:
        return not (reader.retired or self._stop.is_set() or self._finished)

    def _open_and_read(self, reader: Reader) -> None:
        pause_s = POLL_S
        while self._wanted(reader):
            reader.alive_s, reader.may_hang_s = self._clock(), self._settings.opening_s
            before = self._n_frames
            capture = None
            try:
                with quiet_opencv():
                    capture = self._open()
                if capture.isOpened():
                    self._opened = True
                    self._read(reader, capture)
                else:
                    self._fail(reader, "does not open")
            except (OSError, EOFError, cv2.error) as error:
                self._fail(reader, f"does not open: {_line(error)}")
            finally:
                if capture is not None:
                    capture.release()
            reader.alive_s = self._clock()
            if not self._wanted(reader):
                return
            if not self._n_frames:
                raise SourceError("live frames: expected a camera, stream or film that gives frames, found none")
            pause_s = POLL_S if self._n_frames > before else min(2.0 * pause_s, self._settings.hung_s)
            self._nap(pause_s)

    def _read(self, reader: Reader, capture: Capture) -> None:
        """Deliver pictures until the capture ends or `reader` is replaced, or reads fail for settings.blocked_s."""
        times, ends = RisingTimes(self._exposures(), self._settings), self._ends(capture)
        failing_s: float | None = None
        while self._wanted(reader):
            reader.alive_s, reader.may_hang_s = self._clock(), self._settings.hung_s
            image, grabbed_s, why = self._picture(capture)
            reader.alive_s = self._clock()
            if image is not None:
                failing_s = None
                self._take(reader, image, grabbed_s, capture, times)
                continue
            if ends:
                with self._changed:
                    self._finished = self._wanted(reader)
                return
            self._fail(reader, why)
            failing_s = grabbed_s if failing_s is None else failing_s
            if grabbed_s - failing_s > self._settings.blocked_s:
                return
            self._nap(POLL_S)

    def _picture(self, capture: Capture) -> tuple[Image | None, float, str]:
        """The next picture and its arrival time [s]; or None, a time [s], and the reason why there is no picture."""
        try:
            grabbed = capture.grab()
            grabbed_s = self._clock()
            read, image = capture.retrieve() if grabbed else (False, None)
        except (OSError, cv2.error) as error:
            return None, self._clock(), f"a read failed: {_line(error)}"
        if not read:
            return None, grabbed_s, "a read failed"
        if image is None or not np.size(image):
            return None, grabbed_s, "a read gave no picture"
        try:
            return bgr(image), grabbed_s, ""
        except ValueError as error:
            return None, grabbed_s, f"a read gave a {error}"

    def _take(self, reader: Reader, image: Image, grabbed_s: float, capture: Capture, times: RisingTimes) -> None:
        """Deliver a picture. Drop it if it repeats an earlier picture, or if it is not newer than the last frame."""
        with self._changed:
            if not self._wanted(reader):
                return
            if self._reader not in (None, reader):
                self._arrivals.failed()  # after the source is reopened, no picture waits
            self._reader = reader
            for other in self._readers:
                other.retired = other is not reader
            if not self._may_repeat and any(_equal(one, image) for one in self._recent):
                self._watch.saw_repeat(grabbed_s)
                self._arrivals.came(grabbed_s, by_source=times.by_source)
                return
            frame = Frame(self._n_frames, times(capture, grabbed_s), image)
            self._late_s = times.late_s
            self._arrivals.came(grabbed_s, by_source=times.by_source)
            if self._watch.fault is not None:
                self._sparse.began_again()
            self._events += self._watch.saw_new(grabbed_s, (image.shape[1], image.shape[0]))
            if (fault := times.take_fault()) is not None:
                self._events.append(SourceEvent(grabbed_s, EventKind.CLOCK, fault))
            if not self._may_repeat:
                self._events += self._sparse.saw(frame.exposure_s, image)
            self._n_frames += 1
            self._recent.append(image)
            if not frame.exposure_s > self._last_s:
                self.frames_dropped += 1
                return
            self._last_s = frame.exposure_s
            if len(self._waiting) == self._keep:
                self._waiting.popleft()
                self.frames_dropped += 1
            self._waiting.append(frame)
            self._changed.notify_all()

    def _fail(self, reader: Reader, why: str) -> None:
        with self._changed:
            if self._wanted(reader) and self._n_frames:
                self._events += self._watch.saw_failure(self._clock(), why)
                self._arrivals.failed()

    def close(self) -> None:
        """Stop reading. The reading thread releases the device as soon as its unfinished read returns."""
        self._stop.set()
        with self._changed:
            self._changed.notify_all()
            self._changed.wait_for(lambda: not self._readers, timeout=self._settings.blocked_s)


def _equal(one: Image, other: Image) -> bool:
    return one.shape == other.shape and np.array_equal(one[::16], other[::16]) and np.array_equal(one, other)


def _line(error: Exception) -> str:
    return " ".join(str(error).split())
