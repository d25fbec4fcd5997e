"""Live tracking of the target in frames as they arrive: what `softaim live` does.

`Session` has the state of a run.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import astuple, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import vision
from estimators import (
    Advice,
    AdviceSettings,
    CovarianceError,
    Guidance,
    TargetEstimate,
    after_frame,
    health_fault,
)
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.estimate_rows import header, row
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.scene.scene import Scene
from experiments.pipeline.events import DISTRACTOR, distractor_line, report_event, report_move, report_swap
from experiments.pipeline.frame_sources import check_size
from experiments.pipeline.integrity import IntegrityMonitor, shares_words, variance_shares
from experiments.pipeline.line import FILTER, USUAL_BIAS, Line, Step, Watcher
from experiments.pipeline.live.advice import LiveAdvice, nowhere, own_time_s
from experiments.pipeline.live.journal import Act, Done
from experiments.pipeline.live.marks.receiver import MarksFrame
from experiments.pipeline.live.outputs import LiveTable
from experiments.pipeline.live.recording import LiveRecording
from experiments.pipeline.live.shown import Counters, Publisher, Shown, status_text
from experiments.pipeline.live.warm_up import warm_up

ESTIMATES, ADVICE = "estimates.csv", "advice.csv"


WAIT_S = 0.1
"""Time without a frame after which the target is predicted and shown [s]; choice."""

BEHIND_S = 0.25
"""While no frame comes, the filter is predicted to `now - BEHIND_S - 2 * frame_interval` [s]; choice."""

PAUSED, NO_FRAME = "paused: frames are not used", "no frame yet"

LiveFrame = vision.Frame | vision.Exposure | MarksFrame
"""A picture of one camera, pictures of several cameras at one time, or marks of another tracker."""

SOURCE = vision.SourceSettings()
"""Settings of a live source. If no frame comes and the frame interval is unknown, the filter is predicted to a time
`hung_s` [s] before the present. The median frame interval is computed over `settled_frames` frames."""


class Session:
    """One live run: it processes frames, writes and shows the results, and does actions such as a pause.

    needle: the needle's plan; with a plan, advice.csv is written beside the estimates
    watch: called with each frame, its `Step` and the advice
    publisher: called with the state after each frame, and after each prediction without a frame
    rehearse: whether to compile all code before the first frame
    journals: recordings in progress; the run writes each action to all of them, so that a replay can repeat it
    """

    def __init__(
        self,
        scene: Scene,
        rows: Path,
        show: Callable[[str], None],
        *,
        needle: NeedlePlan | None = None,
        watch: Watcher | None = None,
        publisher: Publisher | None = None,
        clock: Callable[[], float] = time.monotonic,
        rehearse: bool = True,
    ) -> None:
        if rehearse:
            warm_up(scene)
        self._explain = watch is not None or publisher is not None
        self.line = Line(scene, baseline=False, explain=self._explain)
        self.watch, self.publisher = watch, publisher
        self.journals: list[LiveRecording] = []
        self.paused = False
        self.integrity = IntegrityMonitor(scene, self.line.filter)
        self.picture: vision.Frame | None = None
        unstated, table = self.integrity.unstated, rows.with_name(ADVICE)
        self.advice = None if needle is None else LiveAdvice(needle, self.line.filter, table, unstated)
        self._clock = clock
        self.counters = Counters()
        self.statuses: Counter[str] = Counter()
        self._show = show
        self._table = LiveTable(rows, header(scene.network.dim))
        self._usable, self._origin_s = True, 0.0
        self._intervals_s: deque[float] = deque(maxlen=SOURCE.settled_frames)
        self._last_s: float | None = None

    def take(self, frame: LiveFrame, waited_s: float = 0.0) -> bool:
        """Estimate the target from one frame, write and show the result; returns whether the frame was used.

        A frame is not used if it is earlier than the filter's state, if it is not later than the last frame, if it
        does not have the size that the scene's camera states, or if the filter refuses its marks.
        waited_s: time that the loop waited for the frame [s]. Raises InputError if the first frame's size is wrong.
        """
        exposure_s = round(frame.exposure_s, 9)
        fits = isinstance(frame, MarksFrame) or self._fits(frame)
        fits = fits and (self._last_s is None or exposure_s > self._last_s)
        for table in self.tables:
            table.begin()
        self._came(exposure_s)
        self._check_filter()
        reached_s = self.line.filter.time_s
        began = time.perf_counter()
        step = self._step(frame, exposure_s) if fits and (reached_s is None or exposure_s >= reached_s) else None
        now_s, estimated = self._clock(), time.perf_counter()
        for journal in self.journals:
            journal.frame(frame, exposure_s, now_s, fits=fits)
        if step is None:
            self.counters.not_used += 1
            return False
        estimate = step.estimates[FILTER]
        self._write(estimate)
        untested = self.integrity.take(estimate, self.line.used(step))
        fault = self._fault or untested
        advised = None if self.advice is None else self.advice.seen(self.line.filter, estimate, now_s, fault)
        ended = time.perf_counter()
        stages_s = {"wait": waited_s, **step.stages_s, "advise": ended - estimated}
        self.counters.add(self._clock() - exposure_s, stages_s, took_s=ended - began, interval_s=self.interval_s)
        self._show(status_text(self._own(estimate), self.interval_s, self.counters.latency_ms, advised))
        self.picture = frame if isinstance(frame, vision.Frame) else None
        if self.watch is not None:
            self.watch.take(None if isinstance(frame, MarksFrame) else frame, self.line, step, advised)
        self._publish(estimate, self.picture, step, advised, now_s)
        return True

    def _came(self, exposure_s: float) -> None:
        if self._last_s is not None:
            self._intervals_s.append(max(exposure_s - self._last_s, 1e-6))
        self._last_s = max(exposure_s, self._last_s or exposure_s)

    def _check_filter(self) -> None:
        """If the filter's state is not finite, restart the filter: such a state would never become finite again."""
        if not self.line.filter.is_finite:
            report_event(self._own_s(self._clock()), "filter", "the state is not finite, so the filter restarts")
            self._restart()

    def _restart(self) -> None:
        self.line = Line(self.line.scene, baseline=False, explain=self._explain)
        self.integrity.restart()
        if self.advice is not None:
            self.advice.forget()

    def unfit(self, exposure_s: float) -> None:
        """Handle an unusable frame with this exposure time [s]."""
        self._came(exposure_s)
        self.counters.not_used += 1

    def _step(self, frame: LiveFrame, exposure_s: float) -> Step | None:
        """The `Step` of a frame; None if the filter refuses its marks. Successive refusals are reported only once."""
        try:
            if isinstance(frame, MarksFrame):
                step = self.line.take(exposure_s, frame.marks)
            elif isinstance(frame, vision.Exposure):
                step = self.line.see_all(vision.Exposure(exposure_s, frame.images))
            else:
                step = self.line.see(exposure_s, frame.image)
        except CovarianceError as error:
            if self._usable:
                report_event(self._own_s(exposure_s), "marks not used", str(error))
            self._usable = False
            return None
        self._usable = True
        for came in () if step.sight is None else step.sight.came:
            report_event(self._own_s(exposure_s), DISTRACTOR, distractor_line(came))
        if step.swap is not None:
            swap = step.swap
            report_swap(replace(swap, time_s=self._own_s(swap.time_s), since_s=self._own_s(swap.since_s)))
        for camera, moved in step.reference.moves.items() if step.reference is not None else ():
            report_move(replace(moved, time_s=self._own_s(moved.time_s)), camera)
        return step

    @property
    def _fault(self) -> str | None:
        """Reason to give no advice even if the newest estimate is good; None if there is no reason."""
        return PAUSED if self.paused else self.integrity.fault

    def _publish(
        self,
        estimate: TargetEstimate,
        frame: vision.Frame | None,
        step: Step | None,
        advised: Guidance | None,
        now_s: float,
    ) -> None:
        if self.publisher is None:
            return
        plan = None if self.advice is None else self.advice.plan
        settings = AdviceSettings() if plan is None else plan.settings
        fault = self._fault or health_fault(estimate, now_s, self.line.filter.seen_s, settings)
        errors, own = shares_words(variance_shares(self.integrity.budget, estimate)), self._own(estimate)
        shown = Shown(own, estimate.time_s, frame, step, advised, plan, fault, self.interval_s, self.counters, errors)
        self.publisher.publish(shown, self.line)

    def _fits(self, frame: vision.Frame | vision.Exposure) -> bool:
        try:
            check_size(frame, self.line.scene)
        except InputError:
            if not self.counters.frames:
                raise
            return False
        return True

    def coast(self, now_s: float) -> None:
        """Predict and show the target at now_s [s] without a frame.

        The filter itself is predicted only to a time before now_s, because a late frame may still come. The estimate at
        that time is written. The estimate at now_s is only shown; without any used frame it has no position.
        """
        self._check_filter()
        tissue, ahead = self.line.filter, nowhere(now_s, self.line.scene.network.dim)
        if self._last_s is None:  # so far nothing has been written
            self._show(NO_FRAME)
            none = None if self.advice is None else Guidance(Advice.NO_GUIDANCE, NO_FRAME)
            self._publish(ahead, None, None, none, now_s)
            return
        self._note(Act.COAST, time_s=now_s)
        interval_s = self.interval_s
        behind_s = now_s - (SOURCE.hung_s if interval_s is None else BEHIND_S + 2.0 * interval_s)
        if tissue.time_s is not None and behind_s > tissue.time_s:
            self._write(self.line.take(behind_s, []).estimates[FILTER])
            self.counters.without_frame += 1
        if tissue.time_s is None or now_s > tissue.time_s:
            if tissue.time_s is not None:
                status = after_frame(tissue.health, now_s, None, 0, tissue.settings).status
                ahead = replace(tissue.predict_at(now_s), status=status)
            advised = None if self.advice is None else self.advice.seen(tissue, None, now_s, self._fault)
            self._show(status_text(self._own(ahead), interval_s, 1e3 * (now_s - self._last_s), advised))
            self._publish(ahead, None, None, advised, now_s)

    def _write(self, estimate: TargetEstimate) -> None:
        self._table.write(row(self._own(estimate)))
        self.statuses[str(estimate.status)] += 1

    def count_from(self, origin_s: float) -> None:
        """Set when the source's own time is zero, for example at the start of a film; origin_s: this clock time [s]."""
        if origin_s != self._origin_s:
            self._note(Act.ORIGIN, time_s=origin_s)
        self._origin_s = origin_s
        if self.advice is not None:
            self.advice.origin_s = origin_s

    def _own(self, estimate: TargetEstimate) -> TargetEstimate:
        """The estimate at the source's own time; its covariance includes all sources of the target's error."""
        return replace(self.integrity.widened(estimate), time_s=self._own_s(estimate.time_s))

    def _own_s(self, time_s: float) -> float:
        return own_time_s(time_s, self._origin_s)

    def _note(self, act: Act, values: Sequence[Any] = (), *, time_s: float | None = None) -> float:
        """Write an action to the journals; time_s: its time, by default the present [s]. Returns the clock time [s]."""
        now_s = self._clock()
        for journal in self.journals:
            journal.note(Done(act, now_s if time_s is None else time_s, now_s, tuple(values)))
        return now_s

    def pause(self, on: bool) -> None:
        """Pause or resume the use of frames; during a pause there is no advice."""
        self._note(Act.PAUSE, [on])
        self.paused = on

    def dated(self, late_s: float, *, uneven: bool) -> None:
        """Set the largest delay from exposure to arrival [s], and whether the frame intervals are uneven."""
        if self.integrity.dated(late_s, uneven=uneven):
            self._note(Act.DATED, [late_s, uneven])

    def reset(self) -> None:
        """Restart the filter: the next frame initialises it."""
        self._note(Act.RESET, time_s=self.line.filter.time_s or 0.0)
        self._restart()
        self.integrity.looked()

    def fix(self, place_m: Floats, sd_m: float) -> None:
        """Use a direct measurement of the target (fix), taken at the time of the newest estimate.

        place_m: measured position [m], (dim,); sd_m: standard deviation [m]. If the scene states no common error of
        fixes, the variance includes `USUAL_BIAS`. Raises ValueError before any estimate, or for a wrong dimension.
        """
        tissue, dim = self.line.filter, self.line.scene.network.dim
        if tissue.time_s is None:
            raise ValueError("fix: expected an estimate first, found none")
        if np.shape(place_m) != (dim,):
            raise ValueError(f"fix: expected {dim} coordinates, found {len(place_m)}")
        bias_m = 0.0 if self.line.scene.settings.fix_bias is not None else USUAL_BIAS.sd_m
        self._note(Act.FIX, [float(x) for x in (*place_m, sd_m)], time_s=tissue.time_s)
        self.line.identity.fix(place_m, (sd_m**2 + bias_m**2) * np.eye(dim))

    def colour(self, node: str, hue: vision.MarkHue) -> None:
        """Set the colour of this node's mark."""
        self._note(Act.HUE, [node, *astuple(hue)])
        self.line.colour(tuple(m.coloured(hue) if m.node == node else m for m in self.line.scene.marks))

    def needle_at(self, tip_m: Floats, direction: Floats) -> None:
        """Set a tracked needle: tip [m], (dim,), and direction, (dim,). Raises ValueError if the run has no needle."""
        advice = self._needle()
        advice.needle_at(tip_m, direction)
        advice.posed_s = self._note(Act.NEEDLE, [float(x) for x in (*tip_m, *direction)])

    def needle_unseen(self) -> None:
        """Record that the tracked needle is no longer visible. Raises ValueError if the run has no needle."""
        self._needle().posed_s = -np.inf
        self._note(Act.NEEDLE)

    def _needle(self) -> LiveAdvice:
        if self.advice is None:
            raise ValueError("needle: expected --needle, for its speed and lesion, found none")
        return self.advice

    def close(self) -> None:
        """Close the tables."""
        for table in self.tables:
            table.close()

    @property
    def has_begun(self) -> bool:
        """Whether a frame has come since the run began."""
        return self._last_s is not None

    @property
    def tables(self) -> list[LiveTable]:
        """The tables of estimates and, if requested, of advice."""
        return [self._table] if self.advice is None else [self._table, self.advice.table]

    @property
    def wait_s(self) -> float:
        """Longest wait for a frame before the target is predicted [s]; `stale_s` of the needle's plan limits it."""
        return WAIT_S if self.advice is None else min(WAIT_S, self.advice.plan.settings.stale_s)

    @property
    def interval_s(self) -> float | None:
        """Median of the last intervals between frames [s]; None before the second frame."""
        return median(self._intervals_s) if self._intervals_s else None
