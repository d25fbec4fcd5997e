"""A breathing phantom in front of a camera: its true motion, its pictures, and a live source with a scripted clock.

SciPy's RK45 computes the motion. Only the script advances the clock; the speed of the machine does not matter.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np

import vision
from dynamics import MassSpringNetwork, all_positions, integrate_adaptive, node_weights, pack, unpack
from estimators import FilterSettings, Insertion
from experiments.arrays import Floats
from experiments.formats.needle_file import force_reach_m
from experiments.formats.scenario import Scenario, read_scenario
from experiments.formats.scene.scene import Scene
from experiments.simulation.film import draw
from experiments.simulation.forces import Force, start_and_forces
from experiments.simulation.simulate import scene_of
from vision.arrays import Image
from vision.sources.events import EventKind, SourceEvent
from vision.sources.exposure_times import DeviceTimes, RisingTimes
from vision.sources.frames import Frame
from vision.sources.live import LiveFrames, Reader

BEGAN_S = 100.0
"""Time on the script's clock at the first exposure [s]."""
INTERVAL_S = 1.0 / 30.0
FINE = 4
"""The true positions are computed at this number of times in each frame interval."""
GREY = (150, 150, 150)
NO_FAULTS = (EventKind.RESUMED, EventKind.ENDED)
"""Kinds of events that are not faults."""
HUES_DEG = (0.0, 120.0, 240.0, 60.0)
"""Hues of the marks [degrees], which are easily distinguished."""


def scenario_of(seed: int, duration_s: float) -> Scenario:
    """Scenario of a breathing phantom in front of a close webcam."""
    close, breathing = read_scenario("webcam"), read_scenario("breathing")
    changes = {"seed": seed, "duration_s": duration_s, "pokes": None, "breathing": breathing.breathing}
    return close.model_copy(update=changes)


def scene_in_view(scenario: Scenario) -> Scene:
    """The scenario's scene with a colour for each mark and the default settings of the filter."""
    scene = scene_of(scenario)
    marks = tuple(replace(mark, hue_deg=hue) for mark, hue in zip(scene.marks, HUES_DEG, strict=True))
    return replace(scene, marks=marks, settings=FilterSettings())


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """True motion of all nodes: positions [m], (n_times, n_nodes, dim), at times since the first exposure [s]."""

    times_s: Floats
    positions: Floats

    def at(self, time_s: float) -> Floats:
        """Positions at this time [s], linearly interpolated, (n_nodes, dim)."""
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
    pushed: Force | None = None,
) -> Motion:
    """Motion of the phantom. At the time at_s [s], `becomes(network)` replaces the network.

    pushed: a force in addition to those of the scenario
    """
    rng = np.random.default_rng(scenario.seed)
    start, forces = start_and_forces(network, scenario, rng)
    forces += [] if pushed is None else [pushed]
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
            method="RK45",
            bends_s=np.concatenate([np.empty(0), *(force.bends_s for force in forces)]),
        )
        positions += [all_positions(body, unpack(x, body.dim)[0]) for x in states[bool(positions) :]]
        state = states[-1]
    return Motion(times, np.array(positions))


@lru_cache(maxsize=64)
def undisturbed(seed: int, duration_s: float) -> Motion:
    """The phantom's motion without a fault; cached, because most faults use the same motion."""
    scenario = scenario_of(seed, duration_s)
    return moved(scenario, scene_in_view(scenario).network, lambda network: network, 0.0)


def pressed(network: MassSpringNetwork, plan: Insertion, inside: Callable[[float], bool], push_N: float) -> Force:
    """Force of a needle on the free nodes near its entry: push_N [N] in total while inside(time) is true, else zero."""
    shares = node_weights(network, plan.entry, force_reach_m(network))[network.free]
    push = push_N * shares[:, None] * plan.axis
    return Force(lambda time_s: push if inside(time_s) else np.zeros_like(push), np.empty(0))


@dataclass(frozen=True, slots=True, eq=False)
class Arrival:
    """Result of one call that reads a frame from the camera.

    at_s: time at which the call returned [s]; image: None if the call failed
    stated_s: exposure time by the camera's clock [s], None if the camera states none
    """

    at_s: float
    image: Image | None
    stated_s: float | None = None


class ScriptedFrames(LiveFrames):
    """A `LiveFrames` without a thread, in which a script replaces the camera; now_s: the script's clock [s]."""

    def __init__(self, arrivals: list[Arrival]) -> None:
        self.now_s = BEGAN_S
        self._to_come = deque(arrivals)
        self._times = RisingTimes(DeviceTimes())
        self._reported: list[str] = []
        super().__init__(lambda: None, clock=lambda: self.now_s)

    def _start_reader(self, now: float) -> None:
        """Start no thread, because `next` reads the frames."""
        self._readers.append(Reader(now, np.inf))
        self._opened = True

    def next(self, timeout_s: float) -> Frame | None:
        """The newest frame. If no frame has arrived, wait for one up to timeout_s [s]; None if no frame arrives."""
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
            image, at_s, why = self._picture(_device(one))
            if image is None:
                self._fail(self._readers[0], why)
            else:
                self._take(self._readers[0], image, at_s, _device(one), self._times)

    def take_events(self) -> tuple[SourceEvent, ...]:
        """The events since the last call. Events that are faults are also stored for `reported`."""
        events = super().take_events()
        self._reported += [f"{one.kind}: {one.text}" for one in events if one.kind not in NO_FAULTS]
        return events

    def reported(self) -> str:
        """Texts of the faults that the source has reported since the last call."""
        reported, self._reported = "; ".join(self._reported), []
        return reported


def _device(read: Arrival) -> Any:
    """An object that behaves like OpenCV's capture device during one read."""
    stated_ms = 0.0 if read.stated_s is None else 1e3 * read.stated_s
    return SimpleNamespace(
        isOpened=lambda: True,
        grab=lambda: read.image is not None,
        retrieve=lambda: (True, read.image),
        get=lambda prop: stated_ms if prop == cv2.CAP_PROP_POS_MSEC else 0.0,
        release=lambda: None,
    )


def drawn(scene: Scene, places: Floats, rng: np.random.Generator, *, hidden: tuple[str, ...] = ()) -> Image:
    """A picture of all nodes at these positions [m], (n_nodes, dim). Grey discs cover the marks of `hidden` nodes."""
    image = draw(scene, places, vision.Lighting(), rng, strays=[])
    camera = scene.cameras[0]
    for mark in scene.marks:
        if mark.node in hidden:
            place = places[scene.network.index(mark.node)]
            (center,), across = camera.project(place[None]), 1e3 * mark.diameter_m / camera.mm_per_px(place)[0]
            cv2.circle(image, (round(center[0]), round(center[1])), round(across), GREY, -1)
    return image
