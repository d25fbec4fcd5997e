"""Five ways to say where a needle should go, from nothing at all to a filter that looks ahead and waits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dynamics import HIDDEN, OUTER, Drive, sliding_forces
from estimators import (
    AdviceSettings,
    Belief,
    MarkMeasurement,
    OpenLoop,
    QuickPath,
    TargetEstimate,
    TargetPath,
    TissueFilter,
    compliance,
    health_fault,
    quick_path,
    quick_tables,
)
from estimators.tissue import Snapshot
from experiments.insertion_world import BELIEVED, FORCES_OFF, World, needle_with

Floats = NDArray[np.float64]

POLICIES = ("rest", "open-loop", "filter", "filter-ahead", "wait-for-go")
HORIZON_S = 1.5
"""So far ahead the target is told [s]: the way of 25 mm at 50 mm/s, later starts, and a target that moves away."""


class Policy(Protocol):
    """What steers a needle; `waits`: whether it starts only on GO, and retracts where a hit becomes improbable."""

    name: str
    waits: bool

    def see(self, time_s: float, marks: Sequence[MarkMeasurement], push: Floats | None) -> None:
        """Take in a frame; push: the needle's since the last one, as believed [N], (n_free, dim)."""

    def path(self, pushes: Floats) -> TargetPath:
        """Where the target is to be looked for from now on; pushes: the needle's in the frames ahead, as believed."""

    def belief_at(self, time_s: float, pushes: Floats) -> Belief | None:
        """What is believed of the target then, None where nothing is."""

    def fault(self, now_s: float) -> str | None:
        """Why it gives no guidance now, None where it does."""


def believed_push(world: World, axis: Floats, depth: float, beside: float, speed: float, steps: int = 0) -> Floats:
    """Forces on the free nodes [N] that the needle is believed to make in coming frames, (n, n_free, dim).

    steps: how many frames; 0: as many as a path is told for. Full cutting and friction forward, friction back.
    """
    n = steps or round(HORIZON_S * world.case.frames_per_s)
    ahead = (np.arange(n) + 0.5) / world.case.frames_per_s
    depths = depth + speed * ahead
    across = np.array([-axis[1], axis[0]])
    tips = world.entry + depths[:, None] * axis + beside * across
    if speed < 0.0:
        free = needle_with(world.entry, BELIEVED | {"cutting_N": 0.0})
        return -sliding_forces(world.network, free, tips, axis, depths)
    return sliding_forces(world.network, needle_with(world.entry, BELIEVED), tips, axis, depths)


def _standing(time_s: float, place: Floats) -> TargetPath:
    dim = len(place)
    return TargetPath(time_s + np.array([0.0, 60.0]), np.array([place, place]), np.zeros((2, dim, dim)))


class Rest:
    """Aim once, at where the target rests. State: time_s, of the last frame."""

    name, waits = "rest", False

    def __init__(self, world: World) -> None:
        self.time_s = 0.0
        self._place = world.network.positions[world.network.index(HIDDEN)]

    def see(self, time_s: float, marks: Sequence[MarkMeasurement], push: Floats | None) -> None:
        """Nothing is taken in."""
        self.time_s = time_s

    def path(self, pushes: Floats) -> TargetPath:
        """Where it rests, for ever."""
        return _standing(self.time_s, self._place)

    def belief_at(self, time_s: float, pushes: Floats) -> Belief | None:
        """None."""
        return None

    def fault(self, now_s: float) -> str | None:
        """None."""
        return None


class Paper(Rest):
    """Follow the paper's open loop, where it says that the target is now. State: that simulation, place now."""

    name = "open-loop"

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self._loop = OpenLoop(world.network, HIDDEN)

    def see(self, time_s: float, marks: Sequence[MarkMeasurement], push: Floats | None) -> None:
        """The simulation goes on to the frame."""
        self.time_s = time_s
        self._place = self._loop.update(time_s, marks).mean


@dataclass(frozen=True, slots=True, eq=False)
class Warm:
    """A filter after the warm-up: what it knew, its last estimate, and its tables."""

    tissue: TissueFilter
    then: Snapshot
    estimate: TargetEstimate
    tables: QuickPath


class Filtered:
    """Follow the filter, where it believes that the target is now. State: the filter, its last estimate."""

    name, waits = "filter", False

    def __init__(self, world: World, warm: Warm) -> None:
        self.tissue, self.estimate, self._tables = warm.tissue, warm.estimate, warm.tables
        self.tissue.restore(warm.then)
        self._compliance = compliance(world.network, HIDDEN)

    def see(self, time_s: float, marks: Sequence[MarkMeasurement], push: Floats | None) -> None:
        """Predict under the believed push, take in the marks."""
        self.tissue.predict(time_s, push)
        self.estimate = self.tissue.update(marks)

    def path(self, pushes: Floats) -> TargetPath:
        """Where it is now, for ever."""
        return _standing(self.estimate.time_s, self.estimate.mean)

    def belief_at(self, time_s: float, pushes: Floats) -> Belief | None:
        """The filter's own prediction, and what wrong forces of the needle make of it."""
        said = self.tissue.predict_modes(time_s, pushes[0])
        return Belief(said.weights, said.means, said.covs + self._by_force(pushes[0]))

    def _by_force(self, push: Floats) -> Floats:
        """Covariance by forces that are off by one factor, uniform within FORCES_OFF: the linear shift times it."""
        shift = self._compliance @ push.ravel()
        return FORCES_OFF**2 / 3.0 * np.outer(shift, shift)

    def fault(self, now_s: float) -> str | None:
        """Of the filter's health."""
        return health_fault(self.estimate, now_s, self.tissue.seen_s, AdviceSettings())


class Ahead(Filtered):
    """Follow where the filter believes that the target will be. State: as `Filtered`."""

    name = "filter-ahead"

    def path(self, pushes: Floats) -> TargetPath:
        """The filter's path by its tables."""
        return TargetPath(*quick_path(self._tables, self.tissue, pushes))


class Waiting(Ahead):
    """As `Ahead`, started on GO, drawn back where a hit becomes improbable. State: as `Filtered`."""

    name, waits = "wait-for-go", True


def warmed(world: World) -> tuple[Floats, Paper, Warm]:
    """The tissue's state, the paper's simulation and the filter at the first frame at which a needle may start.

    That frame itself has not been seen yet.
    """
    case = world.case
    tissue, paper = TissueFilter(world.network, HIDDEN, OUTER), Paper(world)
    tables = quick_tables(tissue, HORIZON_S)
    state, outside = world.start, Drive(world.entry, np.zeros(2), np.array([0.0, -1.0]), -1.0)
    estimate = None
    for k in range(round(case.warm_s * case.frames_per_s)):
        marks = world.marks(k, state)
        paper.see(world.frame_s(k), marks, None)
        tissue.predict(world.frame_s(k))
        estimate = tissue.update(marks)
        state, _ = world.moved(state, outside, (world.frame_s(k), world.frame_s(k + 1)), punctured=False)
    assert estimate is not None
    return state, paper, Warm(tissue, tissue.snapshot(), estimate, tables)
