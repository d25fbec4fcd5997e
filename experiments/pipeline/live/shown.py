"""State of a live run for viewers: the estimate, the advice, and the loop's performance."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

import vision
from estimators import Guidance, TargetEstimate
from experiments.formats.needle_file import NeedlePlan
from experiments.pipeline.line import Line, Step
from experiments.pipeline.live.advice import words
from experiments.pipeline.live.outputs import Latencies

SETTLED_FRAMES = 60
"""After this number of frames all code is loaded, so that the used memory should stay constant; choice."""

STATM = Path("/proc/self/statm")


def memory_mb() -> float | None:
    """Present memory of this process [MB]; None if the system does not report it."""
    try:
        return int(STATM.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    except (OSError, AttributeError, ValueError, IndexError):
        return None


@dataclass(slots=True)
class Counters:
    """Performance counters of the loop since the run began.

    frames, not_used: numbers of used and of unused frames; without_frame: number of predictions without a frame
    dropped: number of frames that newer frames replaced before their use
    late: number of frames whose estimate took longer than the median frame interval
    latencies: latencies from exposure to estimate; latency_ms: latency of the newest frame [ms]
    stages_s: durations of the newest frame's stages [s]: wait (for the frame), predict, detect, update, advise
    began_mb: memory of the process after the first frames [MB]
    """

    frames: int = 0
    without_frame: int = 0
    not_used: int = 0
    dropped: int = 0
    late: int = 0
    latency_ms: float = np.nan
    latencies: Latencies = field(default_factory=Latencies)
    stages_s: Mapping[str, float] = field(default_factory=dict)
    began_mb: float | None = None

    def add(self, latency_s: float, stages_s: Mapping[str, float], *, took_s: float, interval_s: float | None) -> None:
        """Count a used frame, and store its times [s]; the frame is late if took_s exceeds interval_s."""
        self.frames += 1
        self.late += interval_s is not None and took_s > interval_s
        self.latency_ms = 1e3 * latency_s
        self.latencies.add(self.latency_ms)
        self.stages_s = stages_s
        if self.frames == SETTLED_FRAMES:
            self.began_mb = memory_mb()

    @property
    def deadlines_missed(self) -> int:
        """Number of frames that had no estimate when the next frame was due."""
        return self.late + self.dropped

    @property
    def numbers(self) -> dict[str, int]:
        """The counters that count frames, by name."""
        names = ("frames", "without_frame", "dropped", "not_used", "deadlines_missed")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """State of a live run after a frame or a prediction.

    estimate: estimate in the source's own time; at_s: clock time of the estimate [s]
    frame, step: None if the target was predicted without a frame; frame is also None for another tracker's marks
    guidance, plan: the advice, and the needle's plan; None if the run has no needle
    fault: reason why guidance is not possible, stated even without a needle; None if guidance is possible
    interval_s: median interval between frames [s]
    errors: text with the largest sources of the target's variance
    """

    estimate: TargetEstimate
    at_s: float
    frame: vision.Frame | None
    step: Step | None
    guidance: Guidance | None
    plan: NeedlePlan | None
    fault: str | None
    interval_s: float | None
    counters: Counters
    errors: str


class Publisher(Protocol):
    """Protocol of an object that shows the run's state to viewers without delaying the loop."""

    def publish(self, shown: Shown, line: Line) -> None:
        """Publish the present state; line: the run's pipeline."""


def status_text(
    estimate: TargetEstimate, interval_s: float | None, latency_ms: float, advised: Guidance | None = None
) -> str:
    """Text of the status line: time, target, sigma, status, frames per second, latency.

    If there is advice, the line has time, status, latency, sigma and the advice.
    """
    place = ", ".join(f"{1e3 * x:7.2f}" for x in estimate.mean)
    sigma = np.nan if estimate.cov is None else 1e3 * np.sqrt(np.linalg.eigvalsh(estimate.cov)[-1])
    if advised is not None:
        ms = f"{latency_ms:4.0f} ms"
        return f"{estimate.time_s:10.2f} s  {estimate.status:<8} {ms}  sigma {sigma:.2f} mm  {words(advised)}"
    rate = "  – " if interval_s is None else f"{1.0 / interval_s:4.0f}"
    return (
        f"{estimate.time_s:10.2f} s  target ({place}) mm  sigma {sigma:5.2f} mm  {estimate.status:<8}"
        f"  {rate} frames/s  latency {latency_ms:5.1f} ms"
    )
