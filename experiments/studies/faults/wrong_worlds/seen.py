"""Frames of a tracker with noisy marks of a body, and the lines that the tracker sends."""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.arrays import Floats
from experiments.formats.recording import AXES
from experiments.formats.scene.scene import Scene
from experiments.pipeline.live.marks.receiver import LiveMarks, MarksFrame
from experiments.studies.faults.judge import ONSET_S
from experiments.studies.faults.world import BEGAN_S, INTERVAL_S, Motion

MARK_SD_M = 1e-3
"""Standard deviation of the marks' noise on each axis [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Frames of a tracker.

    exposed_s, stated_s: exposure times by the true clock and by the tracker's clock [s], (n,)
    arrive_s: arrival times of the lines by the true clock [s], (n,)
    nodes: nodes of the marks; places: measured positions [m], (n, n_marks, dim)
    middle: centre of the body as drawn [m], (dim,)
    """

    exposed_s: Floats
    stated_s: Floats
    arrive_s: Floats
    nodes: tuple[str, ...]
    places: Floats
    middle: Floats

    def since(self, begins_s: float = ONSET_S, lasts_s: float = np.inf) -> NDArray[np.bool_]:
        """Whether each frame is exposed in the lasts_s [s] after the time begins_s [s], (n,)."""
        return (self.exposed_s >= begins_s) & (self.exposed_s < begins_s + lasts_s)


Sees = Callable[[Seen, np.random.Generator], Seen]


def seen_of(scene: Scene, nodes: tuple[str, ...], motion: Motion, seed: int) -> Seen:
    """Frames of a tracker with marks on these nodes and noise of `MARK_SD_M`, without clock error and delay."""
    times = np.arange(0.0, motion.times_s[-1], INTERVAL_S)
    columns = [scene.network.index(node) for node in nodes]
    places = np.array([motion.at(float(t))[columns] for t in times])
    noise = MARK_SD_M * np.random.default_rng([seed, 7]).normal(size=places.shape)
    middle = 0.5 * (scene.network.positions.min(axis=0) + scene.network.positions.max(axis=0))
    return Seen(times, times, times, nodes, places + noise, middle)


def lines_of(seen: Seen, sd_m: float) -> list[tuple[float, bytes]]:
    """The tracker's lines in the order of arrival, each with its arrival time [s]; sd_m: stated sd of marks [m]."""
    axes = AXES[: seen.places.shape[2]]
    lines = []
    for k, arrives_s in enumerate(seen.arrive_s):
        marks = [
            {"node": node, **dict(zip(axes, (1e3 * seen.places[k, m]).tolist(), strict=True)), "sd_mm": 1e3 * sd_m}
            for m, node in enumerate(seen.nodes)
        ]
        line = json.dumps({"time_s": BEGAN_S + float(seen.stated_s[k]), "marks": marks})
        lines.append((BEGAN_S + float(arrives_s), line.encode()))
    return sorted(lines)


class _Script:
    """A feed that reads nothing, because `ScriptedMarks` adds the lines. State: whether the run is over."""

    def __init__(self) -> None:
        self._over = threading.Event()

    def run(self, _receiver: LiveMarks) -> None:
        """Wait until the run is over."""
        self._over.wait()

    def close(self) -> None:
        """End the run."""
        self._over.set()


class ScriptedMarks(LiveMarks):
    """Live marks from lines with scripted arrival times. State: the script's clock [s], the remaining lines."""

    def __init__(self, scene: Scene, lines: list[tuple[float, bytes]]) -> None:
        self.now_s = BEGAN_S
        self._to_come = deque(lines)
        self._script = _Script()
        self._at_end = False
        super().__init__(scene, self._script, clock=lambda: self.now_s)

    @property
    def ended(self) -> bool:
        """Whether all lines have been used."""
        return self._at_end or super().ended

    def next(self, timeout_s: float) -> MarksFrame | None:
        """The newest frame that has arrived; if there is none, the first that arrives within timeout_s [s]."""
        until_s = self.now_s + timeout_s
        while self._to_come and self._to_come[0][0] <= self.now_s:
            self.take_line(self._to_come.popleft()[1])
        frame = super().next(0.0)
        while frame is None and self._to_come and self._to_come[0][0] <= until_s:
            arrives_s, line = self._to_come.popleft()
            self.now_s = arrives_s
            self.take_line(line)
            frame = super().next(0.0)
        if frame is None:
            self.now_s = until_s
            self._at_end = not self._to_come
        return frame

    def close(self) -> None:
        """End the run and the thread that waits for its end."""
        self._script.close()
        super().close()
