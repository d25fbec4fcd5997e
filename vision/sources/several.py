"""Pictures of several live cameras, in order of exposure. Simultaneous pictures are delivered together."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from vision.sources.events import SourceEvent
from vision.sources.every_frame import FrameFile
from vision.sources.frames import Closing, Exposure, Frame, SourceError
from vision.sources.live import LiveFrames
from vision.sources.opening import played
from vision.sources.playback import Start
from vision.sources.settings import DEFAULTS

TOGETHER_S = 1e-3
"""Largest difference between the exposure times of simultaneous pictures [s]; choice: with a common trigger, the
difference is smaller. A mark at 0.1 m/s moves by 0.1 mm in this time."""

JITTER_S = 5e-3
"""Largest error of the predicted exposure time of a camera's next picture [s]; choice: exposure times have this error
if they are computed from arrival times."""

MOST_WAIT_S, FIRST_S = 0.02, 1.0
"""Longest wait for the next picture of a late camera, and for the first picture of a camera [s]; choice. The first
value is less than a frame interval at 30 frames/s. The second value allows for cameras that open slowly."""

POLL_S = 2e-3
"""Interval between requests to the cameras [s]; choice: short relative to a frame interval of 33 ms."""


class SeveralFrames(Closing):
    """Source of the newest pictures of several cameras. Each picture is delivered at most once.

    Pictures whose exposure times differ by at most `TOGETHER_S` are delivered together. Pictures are delivered in the
    order of their exposure. If a picture of one camera is late, pictures of the other cameras wait for a short time.
    If all cameras of simultaneous pictures have newer pictures, the older ones are dropped. The next pictures of these
    cameras are then delivered first, so that a slow caller gets pictures of every camera.
    sources: source of each camera by name
    clock: the monotonic clock [s]; nap: function that sleeps for a time [s]
    """

    def __init__(
        self,
        sources: Mapping[str, LiveFrames],
        *,
        clock: Callable[[], float] = time.monotonic,
        nap: Callable[[float], object] = time.sleep,
    ) -> None:
        self.sources, self._clock, self._nap = dict(sources), clock, nap
        self._waiting: dict[str, deque[tuple[float, Frame]]] = {name: deque() for name in sources}
        self._last_s = dict.fromkeys(sources, -np.inf)
        self._given_s = -np.inf
        self._skipped: set[str] = set()
        self._dropped = 0

    @property
    def frames_dropped(self) -> int:
        """Number of pictures that were read but not delivered."""
        return self._dropped + sum(one.frames_dropped for one in self.sources.values())

    @property
    def origin_s(self) -> float:
        """Value of `LiveFrames.origin_s` for the first camera [s]."""
        return next(iter(self.sources.values())).origin_s

    @property
    def ended(self) -> bool:
        """Whether no further picture will come."""
        return not any(self._waiting.values()) and all(one.ended for one in self.sources.values())

    @property
    def opening(self) -> bool:
        """Whether a camera is being opened for the first time."""
        return any(one.opening for one in self.sources.values())

    @property
    def waits(self) -> bool:
        """Whether reading has not begun yet. Films are read from the first call of `next` on."""
        return any(one.waits for one in self.sources.values())

    @property
    def late_s(self) -> float:
        """Largest value of `LiveFrames.late_s` among the cameras [s]."""
        return max(one.late_s for one in self.sources.values())

    @property
    def uneven(self) -> bool:
        """Whether `LiveFrames.uneven` is true for any camera."""
        return any(one.uneven for one in self.sources.values())

    def next(self, timeout_s: float) -> Exposure | None:
        """The next pictures; None at the end, or if no picture comes within timeout_s [s]."""
        until = self._clock() + timeout_s
        while True:
            self._fetch()
            exposure = self._first()
            if exposure is not None and all(self._waiting[name] for name in exposure.images):
                self._drop(exposure.images)
                continue
            now = self._clock()
            if exposure is not None or now >= until or self.ended:
                return exposure
            self._nap(min(until - now, POLL_S))

    def _fetch(self) -> None:
        """Fetch the newest picture of each camera. Only this call detects a blocked or frozen camera."""
        for name, source in self.sources.items():
            try:
                frame = source.next(0.0)
            except SourceError as error:
                raise SourceError(f"camera {name}: {error}") from error
            if frame is not None:
                self._waiting[name].append((self._clock(), frame))
                self._last_s[name] = frame.exposure_s

    def _first(self) -> Exposure | None:
        """The next pictures to deliver; None if there are none, or if another camera must be waited for."""
        heads = {name: waiting[0] for name, waiting in self._waiting.items() if waiting}
        if not heads:
            return None
        skipped = {name: one for name, one in heads.items() if name in self._skipped}
        came_s, first = min((skipped or heads).values(), key=lambda one: one[1].exposure_s)
        if any(self._due(name, first.exposure_s, came_s) for name in self.sources if name not in heads):
            return None
        group = [name for name, (_, one) in heads.items() if abs(one.exposure_s - first.exposure_s) <= TOGETHER_S]
        images = {name: self._waiting[name].popleft()[1].image for name in group}
        if not first.exposure_s > self._given_s:  # it came after a later picture was delivered
            self._drop(images)
            return self._first()
        self._given_s = first.exposure_s
        self._skipped -= set(group)
        return Exposure(first.exposure_s, images)

    def _drop(self, cameras: Iterable[str]) -> None:
        """Record that one picture of each camera was dropped. The next pictures of these cameras have priority."""
        self._skipped |= set(cameras)
        self._dropped += len(set(cameras))

    def _due(self, name: str, exposure_s: float, came_s: float) -> bool:
        """Whether to wait for a camera's next picture, because its exposure was probably before exposure_s [s]."""
        source, waited_s = self.sources[name], self._clock() - came_s
        if source.ended:
            return False
        if self._last_s[name] == -np.inf:
            return waited_s < FIRST_S
        since_s = exposure_s - self._last_s[name]
        comes = source.interval_s - JITTER_S <= since_s < DEFAULTS.slow_intervals * source.interval_s
        return comes and waited_s < min(source.interval_s, MOST_WAIT_S)

    def take_events(self) -> tuple[SourceEvent, ...]:
        """The events of all cameras since the last call, camera by camera."""
        return tuple(
            SourceEvent(event.time_s, event.kind, f"camera {name}: {event.text}")
            for name, source in self.sources.items()
            for event in source.take_events()
        )

    def close(self) -> None:
        """Stop, and release all cameras."""
        for source in self.sources.values():
            source.close()


def played_together(films: Mapping[str, FrameFile]) -> SeveralFrames:
    """Source that plays the films of several cameras simultaneously. Each frame is due at its exposure time."""
    start = Start()
    return SeveralFrames({name: played(film, start) for name, film in films.items()})
