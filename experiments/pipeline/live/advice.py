"""Advice on a needle in a live run, from the target's path that the filter and a breathing model predict."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimators import (
    AbortWatch,
    Advice,
    Guidance,
    Status,
    TargetEstimate,
    TargetPath,
    TissueFilter,
    advise,
    health_fault,
    path_by_tables,
    path_reach_s,
    path_tables,
)
from experiments.arrays import Floats
from experiments.formats.needle_file import NeedlePlan
from experiments.pipeline.advise import BreathingPath, header, row
from experiments.pipeline.live.outputs import LiveTable

UNSEEN, SILENT = "the needle's tracker does not see it", "the needle's tracker has sent no pose"


class LiveAdvice:
    """Advice on a needle in a live run; each row is immediately written to advice.csv.

    The time of a row is the exposure time of its frame. If there is no new frame, it is the present time.
    unstated: covariance of target errors that the filter's covariance leaves out [m²], (dim, dim); None means zero
    origin_s: clock time at which the source's own time is zero [s]; the times in advice.csv are the source's own
    counts: how often each advice was given; plan: the needle's plan, which follows a tracked needle
    posed_s: clock time of the tracked needle's last pose [s]; inf without a tracker, -inf if the needle is not visible
    """

    def __init__(self, plan: NeedlePlan, tissue: TissueFilter, rows: Path, unstated: Floats | None = None) -> None:
        self.plan, self._stated, self._unstated = plan, plan.insertion, unstated
        self._watch, self.posed_s = AbortWatch(), np.inf
        self._push = plan.push_on(tissue.network, tissue.target.point)
        self.counts = Counter({str(advice): 0 for advice in Advice})
        self._dim = tissue.network.dim
        self._tables = path_tables(tissue, path_reach_s(tissue, plan.insertion, plan.needle, plan.settings))
        self._breath = BreathingPath(self._dim)
        self._last = nowhere(-np.inf, self._dim)
        self.origin_s = 0.0
        self.table = LiveTable(rows, header(self._dim))
        n = self._tables.n_times
        means, covs = np.tile(plan.insertion.entry, (n, 1)), np.tile(1e-6 * np.eye(self._dim), (n, 1, 1))
        path = TargetPath(self._tables.cycle_s * np.arange(n, dtype=np.float64), means, covs)
        advise(path, plan.insertion, plan.lesion, needle=plan.needle, settings=plan.settings)  # loads compiled code

    def forget(self) -> None:
        """Discard the breathing model and the last estimate, because the filter restarts; the needle is kept."""
        self._breath, self._last = BreathingPath(self._dim), nowhere(-np.inf, self._dim)

    def needle_at(self, tip_m: Floats, direction: Floats) -> None:
        """Set a tracked needle: tip [m], (dim,), and direction, (dim,). Raises ValueError if they are invalid."""
        dim = len(self._stated.entry)
        if np.shape(tip_m) != (dim,) or np.shape(direction) != (dim,):
            raise ValueError(f"needle: expected {dim} coordinates, found {len(tip_m)}, {len(direction)}")
        self.plan = replace(self.plan, insertion=self._stated.tracked(tip_m, direction))

    def seen(
        self, tissue: TissueFilter, estimate: TargetEstimate | None, now_s: float, fault: str | None = None
    ) -> Guidance:
        """Write and return the advice at now_s [s]; without any estimate so far there is no guidance.

        estimate: the newest frame's estimate; None if there is no new frame
        fault: reason to give no guidance even if the estimate is good
        """
        of_s = now_s if estimate is None else estimate.time_s
        if estimate is not None:
            self._last = estimate
            self._breath.learn(tissue, estimate)
        silent_s, most_s = now_s - self.posed_s, self.plan.settings.needle_s
        if silent_s > most_s:
            fault = UNSEEN if np.isinf(silent_s) else f"{SILENT} for {silent_s:.1f} s, more than {most_s:g} s"
        none = None if fault is None else Guidance(Advice.NO_GUIDANCE, fault)
        found = none or self._guided(tissue, self._last, now_s)
        guided = self._watch.checked(found, self.plan.insertion, self.plan.settings, now_s)
        arrival_s = None if guided.arrival_s is None else own_time_s(guided.arrival_s, self.origin_s)
        own = replace(guided, arrival_s=arrival_s)
        self.table.write(row(own_time_s(of_s, self.origin_s), own, self._dim))
        self.counts[str(guided.advice)] += 1
        return guided

    def _guided(self, tissue: TissueFilter, estimate: TargetEstimate, now_s: float) -> Guidance:
        plan = self.plan
        fault = health_fault(estimate, now_s, tissue.seen_s, plan.settings)
        if fault is not None:
            return Guidance(Advice.NO_GUIDANCE, fault)
        path = self._breath.mixed(tissue, path_by_tables(self._tables, tissue))
        path = path if self._unstated is None else path.widened(self._unstated)
        path = self._push.pushed(path, plan.insertion)
        now_s = max(now_s, float(path.times_s[0]))  # exposure times are rounded to a nanosecond
        return advise(path, plan.insertion, plan.lesion, needle=plan.needle, settings=plan.settings, now_s=now_s)


def nowhere(time_s: float, dim: int) -> TargetEstimate:
    """The estimate at a time [s] without any usable frame: INITIALISING, without position or covariance."""
    return TargetEstimate(time_s, np.full(dim, np.nan), None, Status.INITIALISING, 0)


def own_time_s(time_s: float, origin_s: float) -> float:
    """Convert a clock time [s] to the source's own time [s]; origin_s: clock time at the source's time zero [s]."""
    return round(time_s - origin_s, 9) if origin_s else time_s


def words(guided: Guidance) -> str:
    """The advice as one line: the advice, the probability of a hit, the aim, the correction, and the reason."""
    what = str(guided.advice).replace("_", " ")
    if guided.probability is None or guided.aim is None or guided.advice is Advice.ABORT:
        return f"{what}: {guided.reason}"
    aim = ", ".join(f"{1e3 * x:.1f}" for x in guided.aim)
    lateral, depth, turn = guided.lateral_m or 0.0, guided.depth_m or 0.0, guided.turn_rad or 0.0
    return (
        f"{what} {int(100.0 * guided.probability)} %  aim ({aim}) mm, lateral {1e3 * lateral:.1f} mm, "
        f"turn {np.degrees(turn):.1f} deg, {1e3 * depth:.1f} mm to go: {guided.reason}"
    )
