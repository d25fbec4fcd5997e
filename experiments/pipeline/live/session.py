"""Live tracking of frames as they come: what `softaim live` does.

State lives in `Session`: the pipeline, the rows written so far, and the status line.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np

import vision
from estimators import CovarianceError, Guidance, TargetEstimate, after_frame
from experiments.errors import InputError
from experiments.formats.estimate_rows import header, row
from experiments.formats.needle_file import NeedlePlan, read_needle
from experiments.formats.scene.scene import Scene
from experiments.pipeline.events import report_event, report_source_events, report_swap
from experiments.pipeline.frame_sources import check_size, open_source
from experiments.pipeline.line import FILTER, Film, Line, Watcher
from experiments.pipeline.live.advice import LiveAdvice, own_time_s, words
from experiments.pipeline.live.marks.opening import is_mark_source, open_mark_source
from experiments.pipeline.live.marks.receiver import LiveMarks, MarksFrame, MarkSource
from experiments.pipeline.live.outputs import Latencies, LiveTable, StatusLine
from experiments.pipeline.warm_up import warm_up

ADVICE = "advice.csv"


@dataclass(frozen=True, slots=True)
class LiveSettings:
    """How long a live run waits for frames.

    wait_s: without a frame for so long, the target is predicted and shown without one [s]; choice
    behind_s: the filter stays behind by so long, and by two frame intervals, for a frame that comes late [s]; choice
    """

    wait_s: float = 0.1
    behind_s: float = 0.25


LIVE_DEFAULTS = LiveSettings()

SOURCE = vision.SourceSettings()
"""Its hung_s is how far the filter stays behind before two frames gave the interval; its settled_frames are those of
which the median interval is the usual one."""


class Session:
    """One live run.

    needle: what advice is given on, None where none is asked for; advice.csv stands beside the rows of estimates
    watch: is shown each frame, what it gave and the advice
    State: the line, the table of estimates; frames, statuses, rows without a frame, frames not used, counted; the
    advice; whether the filter could use the last frame.
    """

    def __init__(
        self,
        scene: Scene,
        rows: Path,
        show: Callable[[str], None],
        *,
        needle: NeedlePlan | None = None,
        watch: Watcher | None = None,
        clock: Callable[[], float] = time.monotonic,
        settings: LiveSettings = LIVE_DEFAULTS,
    ) -> None:
        warm_up(scene)
        self.settings = settings
        self.line = Line(scene, baseline=False, explain=watch is not None)
        self.watch = watch
        self.advice = None if needle is None else LiveAdvice(needle, self.line.filter, rows.with_name(ADVICE))
        self._clock = clock
        self.n_frames = self.n_coasted = self.n_unused = 0
        self.statuses: Counter[str] = Counter()
        self.latencies = Latencies()
        self._show = show
        self._table = LiveTable(rows, header(scene.network.dim))
        self._usable = True
        self._intervals_s: deque[float] = deque(maxlen=SOURCE.settled_frames)
        self._last_s: float | None = None
        self._origin_s = 0.0

    def take(self, frame: vision.Frame | MarksFrame) -> bool:
        """Estimate, write and show one frame, of pictures or of marks; whether it could be used.

        Not used is a frame older than the filter's state, or of another size than the scene's camera gives.
        Raises InputError where the first frame has another size.
        """
        fits = isinstance(frame, MarksFrame) or self._fits(frame)
        for table in self.tables:
            table.begin()
        if self._last_s is not None:
            self._intervals_s.append(max(frame.exposure_s - self._last_s, 1e-6))
        self._last_s = frame.exposure_s
        reached_s = self.line.filter.time_s
        if not fits or (reached_s is not None and frame.exposure_s < reached_s):
            self.n_unused += 1
            return False
        try:
            if isinstance(frame, MarksFrame):
                step = self.line.take(frame.exposure_s, frame.marks)
            else:
                step = self.line.see(frame.exposure_s, frame.image)
        except CovarianceError as error:
            if self._usable:
                report_event(self._own_s(frame.exposure_s), "marks not used", str(error))
            self._usable = False
            self.n_unused += 1
            return False
        self._usable = True
        if step.swap is not None:
            swap = step.swap
            report_swap(replace(swap, time_s=self._own_s(swap.time_s), since_s=self._own_s(swap.since_s)))
        estimate = step.estimates[FILTER]
        self._write(estimate)
        advised = None if self.advice is None else self.advice.seen(self.line.filter, estimate, self._clock())
        latency_ms = 1e3 * (self._clock() - frame.exposure_s)
        self.latencies.add(latency_ms)
        self.n_frames += 1
        self._show(status_text(self._own(estimate), self.interval_s, latency_ms, advised))
        if self.watch is not None:
            self.watch.take(None if isinstance(frame, MarksFrame) else frame, self.line, step, advised)
        return True

    def _fits(self, frame: vision.Frame) -> bool:
        if not self.n_frames:
            check_size(frame, self.line.scene)
        height, width = frame.image.shape[:2]
        return self.line.scene.cameras[0].size_px == (width, height)

    def coast(self, now_s: float) -> None:
        """Predict and show the target at now_s [s] without a frame.

        The filter itself stays behind, for a frame may yet come; its predictions without a frame are written.
        """
        tissue = self.line.filter
        if tissue.time_s is None or self._last_s is None:
            self._show("no frame yet")
            return
        interval_s, settings = self.interval_s, self.settings
        behind_s = now_s - (SOURCE.hung_s if interval_s is None else settings.behind_s + 2.0 * interval_s)
        if behind_s > tissue.time_s:
            self._write(self.line.take(behind_s, []).estimates[FILTER])
            self.n_coasted += 1
        if now_s > tissue.time_s:
            status = after_frame(tissue.health, now_s, None, 0, tissue.settings).status
            ahead = replace(tissue.predict_at(now_s), status=status)
            advised = None if self.advice is None else self.advice.unseen(tissue, now_s)
            self._show(status_text(self._own(ahead), interval_s, 1e3 * (now_s - self._last_s), advised))

    def _write(self, estimate: TargetEstimate) -> None:
        self._table.write(row(self._own(estimate)))
        self.statuses[str(estimate.status)] += 1

    def count_from(self, origin_s: float) -> None:
        """Tell times as a source does whose own time was nought at origin_s on the clock [s]: those of a film."""
        self._origin_s = origin_s
        if self.advice is not None:
            self.advice.origin_s = origin_s

    def _own(self, estimate: TargetEstimate) -> TargetEstimate:
        return replace(estimate, time_s=self._own_s(estimate.time_s))

    def _own_s(self, time_s: float) -> float:
        return own_time_s(time_s, self._origin_s)

    def close(self) -> None:
        """End the tables."""
        for table in self.tables:
            table.close()

    @property
    def tables(self) -> list[LiveTable]:
        """Of estimates, and of advice where it is asked for."""
        return [self._table] if self.advice is None else [self._table, self.advice.table]

    @property
    def wait_s(self) -> float:
        """Longest wait for a frame before the target is predicted [s]: no longer than advice takes to go stale."""
        wait_s = self.settings.wait_s
        return wait_s if self.advice is None else min(wait_s, self.advice.plan.settings.stale_s)

    @property
    def interval_s(self) -> float | None:
        """Usual time from frame to frame [s], None before two came."""
        return median(self._intervals_s) if self._intervals_s else None


def status_text(
    estimate: TargetEstimate, interval_s: float | None, latency_ms: float, advised: Guidance | None = None
) -> str:
    """Text of the status line: time, target, sigma, status, frames per second, latency.

    With advice: time, status, latency, sigma, and the advice.
    """
    place = ", ".join(f"{1e3 * x:7.2f}" for x in estimate.mean)
    sigma = np.nan if estimate.cov is None else 1e3 * np.sqrt(np.linalg.eigvalsh(estimate.cov)[-1])
    if advised is not None:
        ms = f"{latency_ms:4.0f} ms"
        return f"{estimate.time_s:10.2f} s  {estimate.status:<8} {ms}  sigma {sigma:.2f} mm  {words(advised)}"
    rate = "  – " if interval_s is None else f"{1.0 / interval_s:4.0f}"
    return (
        f"{estimate.time_s:10.2f} s  target ({place}) mm  sigma {sigma:5.2f} mm  {estimate.status:<8}"
        f"  {rate} frames/s  latency {latency_ms:5.1f} ms"
    )


@dataclass(frozen=True, slots=True)
class Followed:
    """What came of a live run: counts of frames, latencies [ms], how often which advice, the fault that it met.

    refused: how much of what a tracker sent could not be used, by kind; None where it was not one that sent
    """

    frames: int
    without_frame: int
    dropped: int
    not_used: int
    statuses: Mapping[str, int]
    latency_median_ms: float
    latency_p99_ms: float
    latency_worst_ms: float
    advice: Mapping[str, int] | None
    refused: Mapping[str, int] | None
    fault: str | None


def live(
    source: str,
    scene_path: Path | None,
    begin: Callable[[Scene], AbstractContextManager[Path]],
    *,
    begun: Callable[[], None] = lambda: None,
    duration_s: float | None = None,
    fps: float | None = None,
    needle_path: Path | None = None,
    film: Callable[[Scene, NeedlePlan | None], Film] | None = None,
) -> Followed:
    """Track the target live until the source ends, the duration is over or Ctrl-C; write estimates.csv.

    begin: opens the folder that rows are written to as they come; begun: called when frames are used. While no frame
    comes the target is predicted; events of the source are reported on standard error. With a needle's file there is
    advice on it, too, in the status line and in advice.csv. film: makes the film of the run. Raises InputError.
    """
    name = f"--source {vision.shown_source(source)}"
    scene, frames = _open(source, scene_path, fps)
    fault: Exception | None = None
    with frames:
        if scene is None:
            raise InputError.at(name, "--scene scene.toml beside it", "none")
        plan = None if needle_path is None else read_needle(needle_path, scene.target.radius_m, scene.network.dim)
        with begin(scene) as folder, StatusLine() as status:

            def shown(text: str) -> None:
                if session.n_frames:
                    begun()
                status.show(text)

            watch = None if film is None else film(scene, plan)
            session = Session(scene, folder / "estimates.csv", shown, needle=plan, watch=watch)
            try:
                follow(session, frames, np.inf if duration_s is None else duration_s)
            except KeyboardInterrupt:
                pass  # Ctrl-C is how a live run ends
            except (vision.SourceError, InputError) as error:
                if not session.n_frames:
                    raise InputError(f"{name}: {error}") from error
                fault = error  # what was estimated until then is kept
            finally:
                report_source_events(frames)
                session.close()
                if watch is not None:
                    watch.finish(folder)
            unwritten = next((table.fault for table in session.tables if table.fault is not None), None)
            fault = fault or unwritten
            refused = dict(frames.refused) if isinstance(frames, LiveMarks) else None
            if not session.n_frames:
                raise InputError.at(
                    name, "frames", "none" + "".join(f", {n} {kind}" for kind, n in (refused or {}).items())
                )
    return Followed(
        session.n_frames,
        session.n_coasted,
        frames.frames_dropped,
        session.n_unused,
        dict(session.statuses),
        session.latencies.quantile_ms(0.5),
        session.latencies.quantile_ms(0.99),
        session.latencies.worst_ms,
        None if session.advice is None else dict(session.advice.counts),
        refused,
        None if fault is None else f"{name}: {fault}" if fault is not unwritten else str(fault),
    )


def _open(source: str, scene_path: Path | None, fps: float | None) -> tuple[Scene | None, vision.Source | MarkSource]:
    if is_mark_source(source):
        return open_mark_source(source, scene_path)
    return open_source(source, scene_path, live=True, fps=fps)


def follow(
    session: Session, frames: vision.Source | MarkSource, duration_s: float, clock: Callable[[], float] = time.monotonic
) -> None:
    """Process frames as they come, and coast where none does, until they end or for duration_s [s]."""
    began = clock()
    while not frames.ended and clock() - began < duration_s:
        frame = frames.next(session.wait_s)
        session.count_from(frames.origin_s)
        report_source_events(frames)
        if (frame is None or not session.take(frame)) and not frames.ended:
            session.coast(clock())
