"""Simulated faults: a live session with a scripted clock tracks pictures of a phantom while one fault acts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from dynamics import MassSpringNetwork, NeedlePose
from estimators import Advice, AdviceSettings, Insertion, Lesion, Needle, Status
from experiments.arrays import Floats
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.scene.scene import Scene
from experiments.pipeline.events import DISTRACTOR, distractor_line
from experiments.pipeline.line import Line
from experiments.pipeline.live.following import follow
from experiments.pipeline.live.marks.receiver import LiveMarks
from experiments.pipeline.live.session import ESTIMATES, Session
from experiments.pipeline.live.shown import Publisher, Shown
from experiments.studies.faults.judge import ONSET_S, Fault, Judged, Moment, covers, is_wrong, verdict
from experiments.studies.faults.world import (
    BEGAN_S,
    INTERVAL_S,
    Arrival,
    Motion,
    ScriptedFrames,
    drawn,
    moved,
    pressed,
    scenario_of,
    scene_in_view,
    undisturbed,
)
from vision.arrays import Image

DURATION_S = 12.0
ARRIVES_S = 0.5 * INTERVAL_S + 0.005
"""Time from exposure to arrival [s]: half a frame interval plus 5 ms of read-out."""
LESION_M = 0.012
"""Radius of the lesion [m]: so large that runs without a fault nearly always display GO."""
ABOVE_M = 0.03
"""Distance from the needle's entry to the target at rest [m]."""
WAYS = {2: (0.0, 1.0), 3: (0.4, 0.3, 1.0)}
"""Direction from the target to the needle's entry, by dimension."""

Thing = TypeVar("Thing")
Alters = Callable[[Image, float, np.random.Generator], Image]
Moves = Callable[[Floats, float, Scene], Floats]
Arrives = Callable[[list[Arrival], np.random.Generator, float], list[Arrival]]
"""Function that changes the list of `Arrival`s during a fault; last argument: duration of the fault [s]."""


@dataclass(frozen=True, slots=True)
class TrackedNeedle:
    """A needle with a tracker.

    pose: function that returns the true pose; arguments: time since the fault's onset [s], planned insertion
    push_N: force on the tissue along the needle's axis while part of the needle is inside [N]
    seen: function that returns whether the tracker sees the needle; argument: time since the fault's onset [s]
    """

    pose: Callable[[float, Insertion], NeedlePose]
    push_N: float = 0.0  # noqa: N815
    seen: Callable[[float], bool] = lambda _since_s: True


def as_is(thing: Thing) -> Thing:
    """Return the argument unchanged."""
    return thing


@dataclass(frozen=True, slots=True)
class ScriptedFault(Fault):
    """A `Fault` that a script simulates.

    picture: function that changes a picture; covered: nodes whose marks are covered in the pictures
    places: function that displaces nodes before they are drawn [m]; arrivals: function that changes the `Arrival`s
    becomes: function that changes the true network at the onset; assumed: function that changes the filter's scene
    needle: a needle with a tracker; None if the needle is not tracked, so that the advice is for the planned path
    upsets: function that disturbs the live session, called once at the onset
    """

    picture: Alters = lambda image, _since_s, _rng: image
    covered: tuple[str, ...] = ()
    places: Moves = lambda places, _since_s, _scene: places
    arrivals: Arrives = lambda arrivals, _rng, _lasts_s: arrivals
    becomes: Callable[[MassSpringNetwork], MassSpringNetwork] = as_is
    assumed: Callable[[Scene], Scene] = as_is
    needle: TrackedNeedle | None = None
    upsets: Callable[[Session], None] = lambda _session: None

    def acts(self, time_s: float) -> bool:
        """Whether the fault acts at this time since the first exposure [s]."""
        return ONSET_S <= time_s < ONSET_S + self.lasts_s

    def judged(self, seed: int, folder: Path, duration_s: float = DURATION_S) -> Judged:
        """Result of a run of `duration_s` [s] with the fault; folder: an existing folder for the run's output."""
        return verdict(self, _moments(self, seed, folder, duration_s), self.lasts_s)


class Watching(Publisher):
    """A `Publisher` that stores what a live run displays. It stores nothing before the time since_s [s].

    reported: function that returns the event messages that are new since the last call of the function
    moments: what was displayed so far; needle: true pose of the needle now
    """

    def __init__(
        self,
        motion: Motion,
        target: int,
        clock: Callable[[], float],
        reported: Callable[[], str] = lambda: "",
        since_s: float = -np.inf,
    ) -> None:
        self._motion, self._target, self._since_s = motion, target, since_s
        self._clock, self._reported = clock, reported
        self.moments: list[Moment] = []
        self.needle: NeedlePose | None = None
        self._used_s = -np.inf

    def publish(self, shown: Shown, line: Line) -> None:
        """Store what is displayed now."""
        if shown.step is not None:
            self._used_s = shown.at_s
        if shown.at_s - BEGAN_S < self._since_s:
            return
        now_s, guidance, estimate = self._clock(), shown.guidance, shown.estimate
        truth = self._motion.at(shown.at_s - BEGAN_S)[self._target]
        measured = len(line.scene.measured_nodes)
        lacking = shown.step is not None and (estimate.marks_used < measured or bool(shown.step.refused))
        why = shown.fault or ("marks lost or refused" if lacking else "")
        inside = self.needle is not None and self.needle.inserted_m > 0.0
        if guidance is not None and (guidance.advice is Advice.ABORT or (inside and guidance.advice is Advice.REALIGN)):
            why = guidance.reason
        cov = estimate.cov
        sight = None if shown.step is None else shown.step.sight
        came = [f"{DISTRACTOR}: {distractor_line(one)}" for one in (() if sight is None else sight.came)]
        self.moments.append(
            Moment(
                now_s - BEGAN_S,
                now_s - self._used_s,
                str(estimate.status),
                None if guidance is None else str(guidance.advice),
                why,
                np.inf if cov is None else float(np.sqrt(np.linalg.eigvalsh(cov)[-1])),
                is_wrong(estimate.mean, cov, truth),
                well=estimate.status is Status.TRACKING and not why,
                reported="; ".join([*filter(None, [self._reported()]), *came]),
                astray=self.needle is not None and misses(self.needle, truth),
                of_frame=shown.step is not None,
                said=shown.fault or ("" if guidance is None else guidance.reason),
                error_m=float(np.linalg.norm(truth - estimate.mean)),
                covered=covers(estimate.mean, cov, truth),
            )
        )


def displayed(
    watching: Watching,
    frames: ScriptedFrames | LiveMarks,
    scene: Scene,
    plan: NeedlePlan,
    folder: Path,
    duration_s: float,
    attend: Callable[[Session], None] = lambda _session: None,
    *,
    rehearse: bool = True,
) -> list[Moment]:
    """What a live run on scripted frames displays; attend: called with the session in each turn of the run's loop."""
    clock = partial(getattr, frames, "now_s")
    session = Session(
        scene, folder / ESTIMATES, lambda _text: None, needle=plan, publisher=watching, clock=clock, rehearse=rehearse
    )
    follow(session, frames, duration_s, clock, attend=partial(attend, session))
    session.close()
    return watching.moments


def misses(needle: NeedlePose, truth_m: Floats) -> bool:
    """Whether a needle that advances along its axis misses the lesion around this position [m], (dim,)."""
    beside = truth_m - needle.tip
    return float(np.linalg.norm(beside - (beside @ needle.direction) * needle.direction)) > LESION_M


def plan_of(scene: Scene) -> NeedlePlan:
    """Plan of a needle so near the target that runs without a fault display GO at any phase of the breath."""
    network = scene.network
    way = np.array(WAYS[network.dim])
    way /= np.linalg.norm(way)
    entry = network.positions[network.index(scene.target.node)] + ABOVE_M * way
    return NeedlePlan(
        insertion=Insertion(entry=entry, axis=-way, speed_m_s=0.5),
        lesion=Lesion.ball(LESION_M, network.dim),
        needle=Needle(),
        settings=AdviceSettings(go=0.5, worth=1.0),
    )


def _moments(fault: ScriptedFault, seed: int, folder: Path, duration_s: float) -> list[Moment]:
    """What a live run with the fault displays."""
    scenario = scenario_of(seed, duration_s)
    scene = scene_in_view(scenario)
    plan, needle = plan_of(fault.assumed(scene)), fault.needle

    def pose(time_s: float) -> NeedlePose:
        assert needle is not None
        return needle.pose(time_s - ONSET_S, plan.insertion)

    pushed = None
    if needle is not None and needle.push_N:
        pushed = pressed(scene.network, plan.insertion, lambda time_s: pose(time_s).inserted_m > 0.0, needle.push_N)
    if pushed is None and fault.becomes is as_is:
        motion = undisturbed(seed, duration_s)
    else:
        motion = moved(scenario, scene.network, fault.becomes, ONSET_S, pushed)
    frames = ScriptedFrames(_arrivals(fault, scene, motion, seed, duration_s))
    clock = partial(getattr, frames, "now_s")
    watching = Watching(motion, scene.network.index(scene.target.node), clock, frames.reported)
    upset = False

    def attend(session: Session) -> None:
        nonlocal upset
        time_s = clock() - BEGAN_S
        if needle is not None:
            watching.needle = pose(time_s)
            if needle.seen(time_s - ONSET_S):
                session.needle_at(watching.needle.tip, watching.needle.direction)
            else:
                session.needle_unseen()
        if fault.acts(time_s) and not upset:
            upset = True
            fault.upsets(session)

    return displayed(watching, frames, fault.assumed(scene), plan, folder, duration_s, attend)


def _arrivals(fault: ScriptedFault, scene: Scene, motion: Motion, seed: int, duration_s: float) -> list[Arrival]:
    rng = np.random.default_rng([seed, 7])
    arrivals = []
    for k in range(int(duration_s / INTERVAL_S)):
        time_s = k * INTERVAL_S
        places, hidden = motion.at(time_s), tuple[str, ...]()
        acts, since_s = fault.acts(time_s), time_s - ONSET_S
        if acts:
            places, hidden = fault.places(places, since_s, scene), fault.covered
        image = drawn(scene, places, rng, hidden=hidden)
        arrivals.append(Arrival(BEGAN_S + time_s + ARRIVES_S, fault.picture(image, since_s, rng) if acts else image))
    return fault.arrivals(arrivals, rng, fault.lasts_s)
