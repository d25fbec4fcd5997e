"""What the waits of a live run are worth: a scripted camera whose frames come late, in bursts, or not at all.

    python -m experiments.studies.settings.sensitivity --out DIR --only live

Pictures of the webcam's phantom at rest, 30 a second. Each arrives 20 ms and some jitter after its exposure; every few
seconds the connection stalls and hands all on at once, or pictures are missing. Time is the script's own, and
estimating takes none of it, so that no figure depends on the machine.
"""

from __future__ import annotations

import tempfile
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import vision
from experiments.arrays import Floats
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import Scene
from experiments.pipeline.live.following import follow
from experiments.pipeline.live.session import LiveSettings, Session
from experiments.simulation.simulate import draw, scene_of
from vision import Frame

SEEDS = (701, 702)
DURATION_S, INTERVAL_S = 12.0, 1.0 / 30.0
DELAY_S, JITTER_S = 0.02, 0.02
"""From exposure to arrival [s], and the mean of what is added at random [s]."""

STALL_EVERY_S = 1.5
STALL_S = (0.1, 0.8)
"""After so long [s] the connection stalls, or pictures are missing, for some time between these [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Script:
    """Exposures and arrivals of a camera's pictures [s], (n,), in order."""

    exposures_s: Floats
    arrivals_s: Floats


def script(seed: int, duration_s: float = DURATION_S) -> Script:
    """Stalls and gaps by turns, each of a length of its own."""
    rng = np.random.default_rng(seed)
    exposures = 100.0 + INTERVAL_S * np.arange(int(duration_s / INTERVAL_S), dtype=np.float64)
    arrivals = exposures + DELAY_S + rng.exponential(JITTER_S, len(exposures))
    there = np.ones(len(exposures), dtype=bool)
    for k, began_s in enumerate(np.arange(100.0 + STALL_EVERY_S, exposures[-1], STALL_EVERY_S)):
        ended_s = began_s + rng.uniform(*STALL_S)
        within = (exposures >= began_s) & (exposures < ended_s)
        if k % 2:
            there[within] = False
        else:
            arrivals[within] = ended_s + DELAY_S
    return Script(exposures[there], np.maximum.accumulate(arrivals)[there])


class ScriptedSource(vision.EveryFrame):
    """Pictures that arrive by a script. State: its time now_s [s], and the pictures still to come."""

    def __init__(self, coming: Script, image: NDArray[np.uint8]) -> None:
        frames = [Frame(k, float(t), image) for k, t in enumerate(coming.exposures_s)]
        self.now_s = float(coming.exposures_s[0])
        self._coming_at = deque(zip(coming.arrivals_s.tolist(), frames, strict=True))

    @property
    def ended(self) -> bool:
        """Whether all pictures have come."""
        return not self._coming_at

    def next(self, timeout_s: float = 0.0) -> Frame | None:
        """The next picture, None where none arrives within the timeout; the time goes on."""
        if self._coming_at and self._coming_at[0][0] <= self.now_s + timeout_s:
            arrival_s, frame = self._coming_at.popleft()
            self.now_s = max(self.now_s, arrival_s)
            return frame
        self.now_s += timeout_s
        return None

    def take_events(self) -> tuple[vision.SourceEvent, ...]:
        """None: the script has no events."""
        return ()


@cache
def _webcam() -> tuple[Scene, NDArray[np.uint8]]:
    scene = scene_of(read_scenario("webcam"))
    return scene, draw(scene, scene.network.positions, vision.Lighting(), np.random.default_rng(0), strays=[])


def _followed(coming: Script, settings: LiveSettings) -> tuple[Session, Floats, Floats]:
    """The session at its end; when something was shown [s], and how far the last row was behind then [s], both (n,)."""
    scene, image = _webcam()
    source = ScriptedSource(coming, image)
    shown: list[float] = []
    behind: list[float] = []

    def show(_text: str) -> None:
        shown.append(source.now_s)
        behind.append(source.now_s - (session.line.filter.time_s or source.now_s))

    with tempfile.TemporaryDirectory() as folder:
        session = Session(scene, Path(folder) / "rows.csv", show, clock=lambda: source.now_s, settings=settings)
        follow(session, source, np.inf, clock=lambda: source.now_s)
        session.close()
    return session, np.array(shown), np.array(behind)


def live_figures(
    settings: LiveSettings, seeds: Sequence[int] = SEEDS, duration_s: float = DURATION_S
) -> dict[str, float]:
    """What comes too late, how old what is shown is, and how often something is computed without a frame.

    late_share: of the pictures that came, those older than the filter's state; coasted_per_s: rows without a picture
    unshown_s: longest time without anything new on the status line [s], mean of the runs
    behind_s: mean time by which the last row is behind the clock, when something is shown [s]
    """
    runs = [_followed(script(seed, duration_s), settings) for seed in seeds]
    sessions = [session for session, _, _ in runs]
    n_late = sum(session.counters.not_used for session in sessions)
    return {
        "late_share": n_late / (n_late + sum(session.counters.frames for session in sessions)),
        "unshown_s": float(np.mean([np.diff(shown).max() for _, shown, _ in runs])),
        "behind_s": float(np.mean(np.concatenate([behind for _, _, behind in runs]))),
        "coasted_per_s": sum(session.counters.without_frame for session in sessions) / (len(seeds) * duration_s),
    }
