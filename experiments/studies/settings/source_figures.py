"""Figures that the settings of live sources serve: exposure times, faults noticed, devices recovered, frames kept.

Captures are simulated and every time is read from a simulated clock; nothing depends on the machine's speed.
`experiments.studies.settings.sensitivity` records what half and twice of each setting cost.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import cv2
import numpy as np

from experiments.arrays import Floats
from experiments.studies.settings.calibration_figures import film_focal_sd
from vision import DeviceTimes, EventKind, LiveFrames, SourceSettings, SourceWatchdog
from vision.arrays import Image

INTERVAL_S = 1.0 / 30.0
SEEDS = range(9100, 9104)
GIVEN_UP_S = 60.0
"""End of a simulated hang; no setting is near it."""


def source_figures(settings: SourceSettings) -> dict[str, float]:
    """Figures by name; all but `hangs_survived` are better when they are lower."""
    return {
        "exposure_error_ms": _exposure_error_ms(settings),
        "false_faults": _false_faults(settings),
        "noticed_s": np.mean([_noticed_s(settings, interval_s) for interval_s in (INTERVAL_S, 0.1, 1.0)]).item(),
        "back_after_hang_s": _recovery_s(settings, 1),
        "back_after_opening_hang_s": _recovery_s(settings, 1, in_opening=True),
        "openings_of_a_slow_device": float(_openings(settings, 15.0)),
        "hangs_survived": float(sum(_recovery_s(settings, n) < GIVEN_UP_S for n in range(1, 10))),
        "stream_given_up_s": settings.stream_opening_s,
        "lost_in_pause": float(_lost(settings, 90)),
        "film_focal_sd": film_focal_sd(settings.sharp_frames),
    }


class _Device:
    """A capture whose own time is set [s]."""

    time_s = 0.0

    def get(self, prop: int) -> float:
        return 1e3 * self.time_s if prop == cv2.CAP_PROP_POS_MSEC else 0.0


def _exposure_error_ms(settings: SourceSettings) -> float:
    """RMS error of exposure times [ms] over devices that are steady, drift, queue, are noisy or silent."""
    squares = []
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        complete_s: Floats = 50.0 + INTERVAL_S * np.arange(900, dtype=np.float64)
        late_s = rng.uniform(0.002, 0.02, 900) + (rng.random(900) < 0.02) * rng.uniform(0.0, 0.08, 900)
        queued_s = late_s.copy()
        for k in range(200, 900, 200):
            queued_s[k : k + 4] = np.linspace(0.5, 0.4, 4)
        cases: tuple[tuple[Floats, Floats], ...] = (
            (complete_s, late_s),
            (50.0 + (complete_s - 50.0) * (1.0 - 2e-4), late_s),
            (complete_s, queued_s),
            (complete_s + rng.normal(0.0, 0.004, 900), late_s),
            (np.zeros(900), late_s),
        )
        for device_s, arrival_s in cases:
            errors = _exposures(settings, device_s, complete_s + arrival_s) - (complete_s - INTERVAL_S / 2.0)
            squares.append((errors[5:] ** 2).mean())
    return 1e3 * float(np.sqrt(np.mean(squares)))


def _exposures(settings: SourceSettings, device_s: Floats, grabbed_s: Floats) -> Floats:
    rule, device, times = DeviceTimes(settings), _Device(), []
    for own_s, grab_s in zip(device_s, grabbed_s, strict=True):
        device.time_s = own_s
        times.append(rule(device, grab_s))
    return np.array(times)


def _false_faults(settings: SourceSettings) -> float:
    """Faults in a thousand frames of cameras whose intervals vary by half, at 30, 5 and 1 frames/s."""
    n = 0
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        for interval_s in (INTERVAL_S, 0.2, 1.0):
            watchdog, now = SourceWatchdog(0.0, settings), 0.0
            for wait_s in interval_s * rng.lognormal(0.0, 0.5, 1000):
                n += any(event.kind is EventKind.BLOCKED for event in watchdog.check(now + wait_s))
                now += wait_s
                watchdog.saw_new(now, (640, 480))
    return n / (3.0 * len(SEEDS))


def _noticed_s(settings: SourceSettings, interval_s: float) -> float:
    """Time from the last frame of a camera that stops to the fault [s]."""
    watchdog = SourceWatchdog(0.0, settings)
    for k in range(60):
        watchdog.saw_new(k * interval_s, (640, 480))
    steps_s = 1e-3 * np.arange(1, 100_000)
    return float(next(step for step in steps_s if watchdog.check(59 * interval_s + step)))


class _Bench:
    """Captures opened one after the other by a simulated clock, of which the first ones hang.

    State: the clock [s], how many captures were opened, how many threads are at rest, the end of all hangs.
    """

    def __init__(self, n_hung: int, *, in_opening: bool) -> None:
        self.now, self.n_opened, self.n_at_rest = 100.0, 0, 0
        self.n_hung, self.in_opening = n_hung, in_opening
        self.over = threading.Event()
        self._lock = threading.Lock()

    def open(self) -> _BenchCapture:
        with self._lock:
            self.n_opened += 1
            number = self.n_opened
        # the first capture gives a frame, for a source that never gave one is an error
        if self.in_opening and 1 < number <= 1 + self.n_hung:
            self.rest()
        return _BenchCapture(self, n_frames=1 if number == 1 or number > self.n_hung + self.in_opening else 0)

    def rest(self) -> None:
        with self._lock:
            self.n_at_rest += 1
        self.over.wait()

    def settle(self, n_threads: Callable[[], int]) -> None:
        while self.n_at_rest < n_threads():
            time.sleep(1e-4)


class _BenchCapture:
    """A capture that gives its frames, then hangs."""

    def __init__(self, bench: _Bench, n_frames: int) -> None:
        self._bench, self._left = bench, n_frames
        self._image = np.full((4, 6, 3), bench.n_opened, dtype=np.uint8)

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        return True

    def grab(self) -> bool:
        if self._bench.over.is_set():
            return False
        if not self._left:
            self._bench.rest()
            return False
        self._left -= 1
        return True

    def retrieve(self) -> tuple[bool, Image]:
        return True, self._image

    def get(self, _prop: int) -> float:
        return 0.0

    def release(self) -> None:
        """Nothing to release."""


def _simulate(bench: _Bench, settings: SourceSettings, lasting_s: float) -> float:
    """Time to the second frame [s] of a source that hangs after its first, lasting_s where none comes."""
    before = set(threading.enumerate())

    def n_threads() -> int:
        return sum(thread.name == "softaim frames" for thread in set(threading.enumerate()) - before)

    with LiveFrames(bench.open, clock=lambda: bench.now, settings=settings) as live:
        bench.settle(n_threads)
        began, n_frames = bench.now, 0
        while bench.now - began < lasting_s:
            n_frames += live.next(0.0) is not None
            bench.settle(n_threads)
            if n_frames == 2:
                break
            bench.now += 0.125
        bench.over.set()
        return bench.now - began


def _recovery_s(settings: SourceSettings, n_hung: int, *, in_opening: bool = False) -> float:
    """Time without frames [s] of a device that hangs n_hung times in a row, in reading or in opening."""
    return _simulate(_Bench(n_hung, in_opening=in_opening), settings, GIVEN_UP_S)


def _openings(settings: SourceSettings, opening_s: float) -> int:
    """How often a device that takes so long [s] to open is opened meanwhile, after its first read hung."""
    bench = _Bench(9, in_opening=True)
    _simulate(bench, settings, settings.hung_s + opening_s)
    return bench.n_opened - 1


def _lost(settings: SourceSettings, n_frames: int) -> int:
    """Frames lost where every one counts and the program pauses for n_frames."""
    done = threading.Event()

    class Burst(_BenchCapture):
        def grab(self) -> bool:
            self._image = np.full((4, 6, 3), self._left, dtype=np.uint8)
            if not self._left:
                done.set()
                return False
            self._left -= 1
            return True

    bench = _Bench(0, in_opening=False)

    def clock() -> float:
        bench.now += 1e-3
        return bench.now

    def ends(_capture: object) -> bool:
        return True

    with LiveFrames(
        lambda: Burst(bench, n_frames), ends=ends, keep=settings.backlog, clock=clock, settings=settings
    ) as live:
        done.wait()
        return n_frames - sum(1 for _ in live)
