"""A breathing phantom before a camera, by a script's own time: its truth, its pictures, and a live source of them.

Truth is SciPy's DOP853. Nothing takes time but the script, so that no figure depends on the machine.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

import vision
from dynamics import MassSpringNetwork, all_positions, integrate_adaptive, pack, unpack
from experiments.arrays import Floats
from experiments.formats.scenario import Scenario, read_scenario
from experiments.formats.scene.scene import Scene
from experiments.simulation.simulate import draw, scene_of, start_and_forces
from vision.arrays import Image
from vision.sources.exposure_times import DeviceTimes, RisingTimes
from vision.sources.frames import Frame
from vision.sources.live import LiveFrames, Reader

BEGAN_S = 100.0
"""The clock at the first exposure [s]."""
INTERVAL_S = 1.0 / 30.0
FINE = 4
"""Times of the truth in a frame's interval."""
GREY = (150, 150, 150)
HUES_DEG = (0.0, 120.0, 240.0, 60.0)
"""Of the marks: such as a user takes who wants them told apart."""


def scenario_of(seed: int, duration_s: float) -> Scenario:
    """A phantom that breathes, before a webcam that is close."""
    close, breathing = read_scenario("webcam"), read_scenario("breathing")
    changes = {"seed": seed, "duration_s": duration_s, "pokes": None, "breathing": breathing.breathing}
    return close.model_copy(update=changes)


def scene_in_view(scenario: Scenario) -> Scene:
    """The scenario's scene with a colour for each mark."""
    scene = scene_of(scenario)
    marks = tuple(replace(mark, hue_deg=hue) for mark, hue in zip(scene.marks, HUES_DEG, strict=True))
    return replace(scene, marks=marks)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Where all nodes truly are: times from the first exposure on [s], (n,), positions [m], (n, n_nodes, dim)."""

    times_s: Floats
    positions: Floats

    def at(self, time_s: float) -> Floats:
        """At this time [s], straight between the times, (n_nodes, dim)."""
        place = np.clip(time_s / self.times_s[-1] * (len(self.times_s) - 1), 0, len(self.times_s) - 1)
        k = min(int(place), len(self.times_s) - 2)
        share = place - k
        found: Floats = (1.0 - share) * self.positions[k] + share * self.positions[k + 1]
        return found


def moved(
    scenario: Scenario,
    network: MassSpringNetwork,
    becomes: Callable[[MassSpringNetwork], MassSpringNetwork],
    at_s: float,
) -> Motion:
    """The phantom's motion, whose network becomes another one at this time [s]."""
    rng = np.random.default_rng(scenario.seed)
    start, forces = start_and_forces(network, scenario, rng)
    n = int(np.ceil(scenario.duration_s / INTERVAL_S)) * FINE + 1
    times = np.arange(n) * INTERVAL_S / FINE
    nothing = np.zeros((len(network.free), network.dim))
    state = pack(start, np.zeros_like(start))
    positions: list[Floats] = []
    first = max(int(at_s / (INTERVAL_S / FINE)), 0)
    for body, part in ((network, times[: first + 1]), (becomes(network), times[first:])):
        if len(part) < 2:
            continue
        states = integrate_adaptive(
            body,
            state,
            part,
            force=lambda t: sum((force(t) for force in forces), nothing),
            rtol=1e-6,
            atol=1e-9,
            max_step_s=1.0 / 60.0,
        )
        positions += [all_positions(body, unpack(x, body.dim)[0]) for x in states[bool(positions) :]]
        state = states[-1]
    return Motion(times, np.array(positions))


@dataclass(frozen=True, slots=True, eq=False)
class Arrival:
    """What a read of the camera gave, and when it came back [s]; image: None where it failed."""

    at_s: float
    image: Image | None


class ScriptedFrames(LiveFrames):
    """A live source whose reads come back when a script says so: `LiveFrames` without its thread.

    State: the script's clock [s], and the reads to come.
    """

    def __init__(self, arrivals: list[Arrival]) -> None:
        self.now_s = BEGAN_S
        self._to_come = deque(arrivals)
        self._times = RisingTimes(DeviceTimes())
        super().__init__(lambda: None, clock=lambda: self.now_s)

    def _start_reader(self, now: float) -> None:
        """No thread reads: `next` does."""
        self._readers.append(Reader(now, np.inf))
        self._opened = True

    def next(self, timeout_s: float) -> Frame | None:
        """The newest frame that came until now, or the first within timeout_s [s]."""
        until_s = self.now_s + timeout_s
        self._read_until(self.now_s)
        while not self._waiting and self._to_come and self._to_come[0].at_s <= until_s:
            self._read_until(self._to_come[0].at_s)
        if not self._waiting:
            self.now_s = until_s
            self._finished = not self._to_come
        return super().next(0.0)

    def _read_until(self, time_s: float) -> None:
        while self._to_come and self._to_come[0].at_s <= time_s:
            one = self._to_come.popleft()
            self.now_s = max(self.now_s, one.at_s)
            image, at_s, why = self._picture(_Read(one))
            if image is None:
                self._fail(self._readers[0], why)
            else:
                self._take(self._readers[0], image, at_s, _Read(None), self._times)


@dataclass(frozen=True, slots=True, eq=False)
class _Read:
    """A device that tells no times, as it is in one read."""

    arrival: Arrival | None

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        return True

    def grab(self) -> bool:
        return self.arrival is not None and self.arrival.image is not None

    def retrieve(self) -> tuple[bool, Image | None]:
        return True, None if self.arrival is None else self.arrival.image

    def get(self, _prop: int) -> float:
        return 0.0

    def release(self) -> None:
        return


def drawn(scene: Scene, places: Floats, rng: np.random.Generator, *, hidden: tuple[str, ...] = ()) -> Image:
    """A picture of all nodes at these places [m], (n_nodes, dim), some marks covered by something grey."""
    image = draw(scene, places, vision.Lighting(), rng, strays=[])
    camera = scene.cameras[0]
    for mark in scene.marks:
        if mark.node in hidden:
            place = places[scene.network.index(mark.node)]
            (center,), across = camera.project(place[None]), 1e3 * mark.diameter_m / camera.mm_per_px(place)[0]
            cv2.circle(image, (round(center[0]), round(center[1])), round(across), GREY, -1)
    return image
