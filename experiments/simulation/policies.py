"""Insertion policies: five rules by which a robot aims, starts and retracts a needle."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cache

import numpy as np

from dynamics import sliding_friction
from estimators import (
    AdviceSettings,
    AheadTables,
    Breathing,
    GaussianMixture,
    MarkMeasurement,
    OpenLoop,
    TargetEstimate,
    TargetPath,
    TissueFilter,
    breathing_ahead,
    breathing_track,
    compliance,
    either_path,
    health_fault,
    path_by_tables,
    path_reach_s,
    path_tables,
)
from estimators.core.track import FilterSnapshot
from estimators.process.target import target_map
from experiments.arrays import Floats
from experiments.formats.scene import space_marks
from experiments.simulation.cases import way_m
from experiments.simulation.world import World, needle_with

POLICIES = ("rest", "open-loop", "filter", "filter-ahead", "wait-for-go")
SETTLED_S = 0.5
"""Time from the start of a run to the start of the breathing model [s]; a study parameter: early estimates are poor."""

WAYS, MARGIN_S = 1.5, 0.75
"""The prediction range of the target is `WAYS * (insertion time) + MARGIN_S` [s], because the needle may start later or
the target may move away from the needle; study parameters."""


class Policy:
    """A policy that steers a needle.

    place: position at which the policy aims [m], (dim,)
    time_s: time of the last frame [s]
    waits: if True, the needle starts only if guidance advises GO. It retracts after a fault, or if a hit is improbable.
    """

    name, waits = "", False
    time_s: float
    place: Floats

    def see(self, time_s: float, marks: Sequence[MarkMeasurement], push: Floats | None) -> None:
        """Process a frame's marks. `push` is the predicted needle force since the last frame [N], (n_free, dim)."""
        self.time_s = time_s

    def path(self, pushes: Floats) -> TargetPath:
        """Predicted path of the target. `pushes` are needle forces in steps of CYCLE_S [N], (n, n_free, dim)."""
        dim = len(self.place)
        times_s = self.time_s + np.array([0.0, 60.0])
        return TargetPath(times_s, np.array([self.place, self.place]), np.zeros((2, dim, dim)))

    def density_at(self, time_s: float, parts: Floats) -> GaussianMixture | None:
        """Probability density of the target's position at time_s; None if the policy predicts no density.

        parts: predicted cutting force and friction [N], (2, n_free, dim); both are constant until `time_s`
        """
        return None

    def fault(self, now_s: float) -> str | None:
        """Reason why the policy cannot guide the needle now; None if it can."""
        return None


def horizon_s(world: World) -> float:
    """Prediction range of the target [s], a multiple of the frame interval."""
    case = world.case
    ahead_s = WAYS * way_m(case.truth, case.plan) / case.plan.insertion.speed_m_s + MARGIN_S
    return float(np.ceil(ahead_s * case.frames_per_s * (1.0 - 1e-9)) / case.frames_per_s)


def across(axis: Floats) -> Floats:
    """Unit vectors perpendicular to a unit vector (dim,) and to each other, (dim - 1, dim)."""
    if len(axis) == 2:
        return np.array([[-axis[1], axis[0]]])
    return space_marks.across(axis[None])[0].T


def predicted_parts(
    world: World, axis: Floats, depth: float, beside: Floats, speed: float, n: int, step_s: float
) -> Floats:
    """Cutting force and friction on the free nodes, predicted for the next n time steps [N], (2, n, n_free, dim).

    beside: offset of the needle from its initial line, along each vector of `across(axis)` [m], (dim - 1,)
    speed: speed along the axis [m/s], negative during retraction; step_s: time step [s]
    """
    ahead = step_s * (np.arange(n, dtype=np.float64) + 0.5)
    depths = depth + speed * ahead
    tips = world.entry + depths[:, None] * axis + beside @ across(axis)
    network, stated = world.assumed, world.case.plan.forces.constants()
    cutting, friction = (
        sliding_friction(network, needle_with(network, world.entry, stated | {without: 0.0}), tips, axis, depths)
        for without in ("friction_N_m", "cutting_N")
    )
    return np.array([cutting, friction] if speed >= 0.0 else [np.zeros_like(cutting), -friction])


def force_error_cov(gives: Floats, parts: Floats, error: float) -> Floats:
    """Covariance of the target's position due to errors of the predicted needle force [m²], (dim, dim).

    Each part of the force has an independent relative error, uniformly distributed between -error and error.
    gives: the target's compliance [m/N], (dim, n_free * dim)
    parts: parts of the force [N], (n_parts, n_free, dim)
    """
    shifts = parts.reshape(len(parts), -1) @ gives.T
    return error**2 / 3.0 * shifts.T @ shifts


class Rest(Policy):
    """Policy: aim at the target's rest position."""

    name = "rest"

    def __init__(self, world: World) -> None:
        network, self.time_s = world.assumed, 0.0
        target = target_map(network, world.case.given.target.point)
        self.place = target.position(network.positions[network.free].ravel())


class Paper(Rest):
    """Policy: aim at the present position of the target in the open-loop simulation of [paper]."""

    name = "open-loop"

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self._loop = OpenLoop(world.case.given.network, world.case.given.target.point)

    def see(self, time_s: float, marks: Sequence[MarkMeasurement], push: Floats | None) -> None:
        """Advance the open-loop simulation to the frame's time."""
        self.time_s, self.place = time_s, self._loop.update(time_s, marks).mean


@dataclass(frozen=True, slots=True, eq=False)
class Warm:
    """A filter after the warm-up.

    then: the filter's state
    tables: prediction tables of the policies; of_advice: prediction tables of `softaim advise`
    """

    tissue: TissueFilter
    then: FilterSnapshot
    estimate: TargetEstimate
    tables: AheadTables
    of_advice: AheadTables
    breathing: Breathing


class Filtered(Policy):
    """Policy: aim at the filter's estimate of the target's present position."""

    name = "filter"

    def __init__(self, world: World, warm: Warm) -> None:
        self.tissue, self.estimate, self._tables = warm.tissue, warm.estimate, warm.tables
        self.time_s, self.place = warm.estimate.time_s, warm.estimate.mean
        self.tissue.restore(warm.then)
        self._compliance = compliance(world.assumed, world.case.given.target.point)
        self._error = world.case.plan.forces.error

    def see(self, time_s: float, marks: Sequence[MarkMeasurement], push: Floats | None) -> None:
        """Predict the filter's state with `push` as a known force, then update it with the marks."""
        self.tissue.predict(time_s, push)
        self.estimate = self.tissue.update(marks)
        self.time_s, self.place = time_s, self.estimate.mean

    def density_at(self, time_s: float, parts: Floats) -> GaussianMixture:
        """The filter's predicted density; its covariances include the error of the predicted needle force."""
        ahead = self.tissue.predict_modes(time_s, parts.sum(axis=0))
        unknown = force_error_cov(self._compliance, parts, self._error)
        return GaussianMixture(ahead.weights, ahead.means, ahead.covs + unknown)

    def fault(self, now_s: float) -> str | None:
        """Reason why the filter's last estimate cannot be used, see `health_fault`; None if there is no reason."""
        return health_fault(self.estimate, now_s, self.tissue.seen_s, AdviceSettings())


class Ahead(Filtered):
    """Policy: predict the target's position at the time when the needle arrives, and aim at this position.

    While the breathing model is valid, the prediction is a mixture of the predictions by this model and by the filter.
    The model describes motion without the needle; the target's shift by the needle is added to its prediction.
    """

    name = "filter-ahead"

    def __init__(self, world: World, warm: Warm) -> None:
        super().__init__(world, warm)
        self._breathing = deepcopy(warm.breathing)

    def see(self, time_s: float, marks: Sequence[MarkMeasurement], push: Floats | None) -> None:
        """Update the filter, then the breathing model."""
        super().see(time_s, marks, push)
        shift = 0.0 if push is None else self._compliance @ push.ravel()
        self._breathing.update(time_s, *breathing_track(self.tissue, self.estimate.mean - shift))

    def path(self, pushes: Floats) -> TargetPath:
        """The filter's predicted path, mixed with the breathing model's path while this model is valid."""
        path = path_by_tables(self._tables, self.tissue)
        path = path.moved(self._tables.shift(pushes), np.zeros_like(path.covs[0]))
        if self._breathing.breath() is None:
            return path
        n, times = self._tables.n_times, path.times_s
        means, covs = breathing_ahead(self._breathing, self.tissue, times)
        breath = TargetPath(times, means + self._shifts(pushes[np.minimum(np.arange(n), len(pushes) - 1)]), covs)
        return either_path(breath, path, self._breathing.holds(times))

    def density_at(self, time_s: float, parts: Floats) -> GaussianMixture:
        """The filter's predicted density, mixed with the breathing model's density while this model is valid."""
        own = super().density_at(time_s, parts)
        if self._breathing.breath() is None:
            return own
        at = np.array([time_s])
        mean, cov = breathing_ahead(self._breathing, self.tissue, at)
        holds = self._breathing.holds(at)
        return GaussianMixture(
            np.concatenate([holds, (1.0 - holds) * own.weights]),
            np.concatenate([mean + self._shifts(parts).sum(axis=0), own.means]),
            np.concatenate([cov + force_error_cov(self._compliance, parts, self._error), own.covs]),
        )

    def _shifts(self, pushes: Floats) -> Floats:
        """Static displacement of the target [m] by each of n forces, (n, dim), in linear approximation."""
        return pushes.reshape(len(pushes), -1) @ self._compliance.T


class Waiting(Ahead):
    """Policy `Ahead`, but the needle starts only if guidance advises GO, and retracts if a hit becomes improbable."""

    name, waits = "wait-for-go", True


@cache
def _tables(model: bytes, ahead_s: float) -> AheadTables:
    """Prediction tables of a filter for the prediction range `ahead_s` [s]. `model` has its pickled arguments."""
    network, target, marked, settings, uncertainty = pickle.loads(model)
    tissue = TissueFilter(network, target, marked, settings, uncertainty=uncertainty)
    return path_tables(tissue, ahead_s)


def warmed(world: World) -> tuple[Floats, Paper, Warm]:
    """The tissue's state at the first frame after the warm-up; open-loop policy and filter after the frame before."""
    case, given = world.case, world.case.given
    own = (given.network, given.target.point, given.measured_nodes, given.settings)
    tissue, paper = TissueFilter(*own, uncertainty=given.uncertainty), Paper(world)
    model = pickle.dumps((*own, given.uncertainty))
    reach_s = path_reach_s(tissue, case.straight, case.plan.needle, case.plan.settings)
    tables, of_advice = _tables(model, horizon_s(world)), _tables(model, reach_s)
    state, estimate, breathing = world.start, None, Breathing(world.network.dim)
    for k in range(round(case.warm_s * case.frames_per_s)):
        marks = world.marks(k, state)
        paper.see(world.frame_s(k), marks, None)
        tissue.predict(world.frame_s(k))
        estimate = tissue.update(marks)
        if world.frame_s(k) >= SETTLED_S:
            breathing.update(world.frame_s(k), *breathing_track(tissue, estimate.mean))
        state = world.untouched(state, k)
    if estimate is None:
        raise ValueError(f"warm_s: expected one frame interval or more, found {case.warm_s} s")
    return state, paper, Warm(tissue, tissue.snapshot(), estimate, tables, of_advice, breathing)
