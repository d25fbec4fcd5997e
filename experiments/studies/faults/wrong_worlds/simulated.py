"""True bodies of the study, their motion by SciPy's DOP853, and a tracker that sends the positions of marks as text."""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics import HIDDEN, OUTER, MassSpringNetwork, Phantom, breast_phantom, four_mass_phantom, planar_phantom
from estimators import FilterSettings
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.recording import AXES
from experiments.formats.scenario import Scenario, read_scenario
from experiments.formats.scenario_forces import Breathing, Pokes, Posture
from experiments.formats.scene.reference import Reference
from experiments.formats.scene.scene import Scene
from experiments.pipeline.live.marks.receiver import LiveMarks, MarksFrame
from experiments.projects.template import scene_with_marks
from experiments.simulation.forces import breathing_force, poke_force
from experiments.studies.faults.judge import ONSET_S
from experiments.studies.faults.world import BEGAN_S, INTERVAL_S, Motion, moved


@dataclass(frozen=True, slots=True)
class Body:
    """A body, and the duration of its runs [s]."""

    phantom: Callable[[], Phantom]
    duration_s: float


def _four_masses() -> Phantom:
    network = four_mass_phantom()
    return Phantom(network, HIDDEN, OUTER, ("springs",) * len(network.springs))


BODIES = {
    "four masses": Body(_four_masses, 12.0),
    "light phantom": Body(lambda: planar_phantom(5), 12.0),
    "breast": Body(lambda: breast_phantom(10), 8.0),
}


@lru_cache(maxsize=8)
def scene_of_body(name: str) -> Scene:
    """Scene of a body. Each mark has a colour, and no uncertainty is stated."""
    scene = scene_with_marks(BODIES[name].phantom(), {})
    target = replace(scene.target, position_sd_m=None)
    return replace(scene, target=target, reference=Reference(), settings=FilterSettings())


Becomes = Callable[[MassSpringNetwork], MassSpringNetwork]
Changes = Callable[[Scene, np.random.Generator], MassSpringNetwork]
"""Function that returns the true network of a scene."""

SECOND = {2: [1.0, -0.2], 3: [1.0, -0.2, 0.4]}
"""Direction of the second breath, by dimension of the body. The first breath acts upwards."""

TURNS_S = 4.0
"""Time at which gravity begins to turn [s]."""


@dataclass(frozen=True, slots=True)
class Pushes:
    """Forces on the body.

    pokes_m_s2: acceleration of marked nodes by short forces (pokes) [m/s²]; 0 for no pokes
    breath_m_s2: acceleration by a breath [m/s²]; 0 for no breath
    everywhere: whether the breath accelerates all free nodes; hidden: whether pokes also act on the target
    turned_deg: angle by which gravity turns in 2 s
    second: whether a second breath acts, with another period and another direction
    """

    pokes_m_s2: float = 5.0
    breath_m_s2: float = 2.0
    everywhere: bool = False
    turned_deg: float = 0.0
    hidden: bool = False
    second: bool = False


PUSHES = Pushes()


@dataclass(frozen=True, slots=True)
class Truth:
    """The true body and the forces on it.

    network: function that returns the true network; becomes: function that changes the true network at onset_s [s]
    """

    network: Changes = lambda scene, _rng: scene.network
    becomes: Becomes = lambda network: network
    onset_s: float = 0.0
    pushes: Pushes = PUSHES


AS_STATED = Truth()


@lru_cache(maxsize=32)
def motion_of(scene: Scene, truth: Truth, seed: int, duration_s: float) -> Motion:
    """The true motion of a scene's body, cached. Raises RuntimeError if the body has no rest shape."""
    network = truth.network(scene, np.random.default_rng([seed, 11]))
    scenario = _scenario(scene, truth.pushes, seed, duration_s)
    more = None
    if truth.pushes.second:
        breath = _breath(scene, truth.pushes, SECOND[network.dim])
        more = breathing_force(network, breath, np.random.default_rng([seed, 12]))
    if truth.pushes.hidden:
        pokes = _pokes(truth.pushes, [scene.target.node])
        more = poke_force(network, pokes, duration_s, np.random.default_rng([seed, 12]))
    try:
        return moved(scenario, network, truth.becomes, truth.onset_s, more)
    except InputError as error:
        raise RuntimeError(f"truth: {error}") from error


def _scenario(scene: Scene, pushes: Pushes, seed: int, duration_s: float) -> Scenario:
    changes = {
        "seed": seed,
        "duration_s": duration_s,
        "tremor": None,
        "pokes": _pokes(pushes, list(scene.measured_nodes)) if pushes.pokes_m_s2 else None,
        "breathing": _breath(scene, pushes) if pushes.breath_m_s2 else None,
        "posture": _posture(scene.network.gravity, pushes.turned_deg) if pushes.turned_deg else None,
    }
    return read_scenario("poked").model_copy(update=changes)


def _pokes(pushes: Pushes, nodes: list[str]) -> Pokes:
    return Pokes(nodes=nodes, acceleration_m_s2=pushes.pokes_m_s2, shortest_s=0.1, longest_s=0.4, pause_s=1.5)


def _posture(gravity: Floats, turned_deg: float) -> Posture:
    """A rotation of gravity by turned_deg [degrees], from the axis of gravity towards the next coordinate axis."""
    angle = np.radians(turned_deg)
    to = np.cos(angle) * gravity + np.sin(angle) * np.roll(gravity, 1)
    return Posture(from_m_s2=gravity.tolist(), to_m_s2=to.tolist(), start_s=TURNS_S)


def _breath(scene: Scene, pushes: Pushes, direction: list[float] | None = None) -> Breathing:
    free = [scene.network.names[i] for i in scene.network.free]
    return Breathing(
        nodes=free if pushes.everywhere else list(scene.measured_nodes),
        acceleration_m_s2=pushes.breath_m_s2,
        shortest_s=3.0,
        longest_s=6.0,
        direction=direction,
    )


MARK_SD_M = 1e-3
"""Standard deviation of the marks' noise on each axis [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Frames of a tracker.

    exposed_s, stated_s: exposure times by the true clock and by the tracker's clock [s], (n_frames,)
    arrive_s: arrival times of the frames by the true clock [s], (n_frames,)
    nodes: nodes of the marks; places: measured positions [m], (n_frames, n_marks, dim)
    middle: centre of the body at rest [m], (dim,)
    """

    exposed_s: Floats
    stated_s: Floats
    arrive_s: Floats
    nodes: tuple[str, ...]
    places: Floats
    middle: Floats

    def since(self, lasts_s: float = np.inf) -> NDArray[np.bool_]:
        """Whether each frame is exposed within lasts_s [s] from ONSET_S on, (n_frames,)."""
        return (self.exposed_s >= ONSET_S) & (self.exposed_s < ONSET_S + lasts_s)


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
    """Arrival times [s] and lines of text that the tracker sends, in order; sd_m: stated sd of the marks [m]."""
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


class ScriptedMarks(LiveMarks):
    """A `LiveMarks` that receives scripted lines at scripted times; now_s: the script's clock [s]."""

    def __init__(self, scene: Scene, lines: list[tuple[float, bytes]]) -> None:
        self.now_s = BEGAN_S
        self._to_come = deque(lines)
        self._at_end = False
        self._over = threading.Event()  # the feed reads nothing until then, because `next` adds the lines
        feed: Any = SimpleNamespace(run=lambda _receiver: self._over.wait(), close=self._over.set)
        super().__init__(scene, feed, clock=lambda: self.now_s)

    @property
    def ended(self) -> bool:
        """Whether all lines have arrived, and the last call of `next` has found no frame."""
        return self._at_end or super().ended

    def next(self, timeout_s: float) -> MarksFrame | None:
        """The newest frame. If no frame has arrived, wait for one up to timeout_s [s]; None if no frame arrives."""
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
        """Close the source, and end its thread."""
        self._over.set()
        super().close()
