"""Live tracking of a target until the source ends: what `softaim live` does around its `Session`."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

import vision
from experiments.errors import InputError, placed
from experiments.formats.needle_file import NeedlePlan, read_needle
from experiments.formats.scene.scene import Scene, read_scene, write_scene
from experiments.interrupts import as_interrupts
from experiments.log import LOG, SHOWN
from experiments.pipeline.events import report_source_events
from experiments.pipeline.frame_sources import check_size, open_live, without_fps
from experiments.pipeline.line import Film
from experiments.pipeline.live.control import Control
from experiments.pipeline.live.marks.opening import is_mark_source, open_mark_source
from experiments.pipeline.live.marks.receiver import LiveMarks, MarkSource
from experiments.pipeline.live.outputs import StatusLine
from experiments.pipeline.live.preparing import PREPARING, Cameras, prepared
from experiments.pipeline.live.session import ESTIMATES, Session
from experiments.pipeline.live.shown import Publisher, memory_mb
from experiments.simulation.phantom_process import PhantomProcess

SCENE = "scene.toml"

Frames = vision.Source | vision.SeveralFrames | MarkSource
"""Sources of a live run: pictures of one camera, pictures of several cameras, or marks."""


class Attendant(Publisher, Protocol):
    """Protocol of a publisher that also shows frames before the first estimate, and handles viewers' requests."""

    def prepare(self, frame: vision.Frame | None, n_shown: int, time_s: float) -> None:
        """Show a frame without an estimate; if `frame` is None, report that there is no frame.

        n_shown: number of frames so far; time_s: time of the frame or, without a frame, present time of the source [s]
        """

    def attend(self, control: Control) -> None:
        """Handle the requests that viewers have made since the last call; called between two frames."""


def live(
    sources: Sequence[str],
    scene_path: Path | None,
    begin: Callable[[Scene], AbstractContextManager[Path]],
    *,
    begun: Callable[[], None] = lambda: None,
    duration_s: float | None = None,
    fps: float | None = None,
    needle_path: Path | None = None,
    film: Callable[[Scene, NeedlePlan | None], Film] | None = None,
    attendant: Callable[[Scene, NeedlePlan | None], Attendant] | None = None,
    record: bool = False,
    phantom: PhantomProcess | None = None,
) -> dict[str, Any]:
    """Track the target live; write scene.toml, estimates.csv and, with a needle file, advice.csv. Raises InputError.

    The run ends when the source ends, after duration_s [s] or at Ctrl-C. While no frame comes, the target is predicted.
    sources: one source, or NAME=SOURCE for each camera in space; begin: opens the output folder
    begun: called after the first used frame, and again later; film: creates the film of the run
    attendant: creates the object that shows the run to viewers; record: whether to record from the first frame on
    phantom: process of the simulated phantom, if already started
    """
    shown_source = ", ".join(map(vision.shown_source, sources))
    name = f"--source {shown_source}"
    scene, frames = _open(sources, scene_path, fps, phantom)
    fault: Exception | None = None
    with frames:
        if scene is None:
            raise InputError.at(name, "--scene scene.toml beside it", "none")
        plan = None if needle_path is None else read_needle(needle_path, scene.target.radius_m, scene.network.dim)
        with begin(scene) as folder, StatusLine() as status, SHOWN.unwaited():

            def shown(text: str) -> None:
                if session.counters.frames:
                    begun()
                if session.counters.frames == 1:
                    _write(used, folder / SCENE)
                status.show(text)

            watch = None if film is None else film(scene, plan)
            viewer = None if attendant is None else attendant(scene, plan)
            used = as_written(scene)
            make = partial(Session, used, folder / ESTIMATES, shown, needle=plan, watch=watch, publisher=viewer)
            session = _prepared(make, frames, name, scene=used, plan=plan, status=status, viewer=viewer)
            control = Control(
                session, folder, source=shown_source, needle=None if needle_path is None else needle_path.read_bytes()
            )

            def attend() -> None:
                if viewer is not None:
                    viewer.attend(control)

            try:
                if record:
                    control.record(True)
                with as_interrupts():
                    follow(session, frames, np.inf if duration_s is None else duration_s, attend=attend)
            except KeyboardInterrupt:
                pass  # Ctrl-C ends a live run
            except (vision.SourceError, InputError) as error:
                if not session.counters.frames:
                    raise InputError(f"{name}: {error}") from error
                fault = error  # estimates so far stay in the file
            finally:
                report_source_events(frames)
                recordings = control.finish()
                session.close()
                if watch is not None:
                    watch.finish(folder)
            refused = dict(frames.refused) if isinstance(frames, LiveMarks) else None
            if not session.counters.frames:
                raise InputError.at(
                    name, "frames", "none" + "".join(f", {n} {kind}" for kind, n in (refused or {}).items())
                )
    return _report(session, name, fault, refused, recordings)


def _prepared(
    make: Callable[[], Session],
    frames: Frames,
    name: str,
    *,
    scene: Scene,
    plan: NeedlePlan | None,
    status: StatusLine,
    viewer: Attendant | None,
) -> Session:
    """Prepare the session. Meanwhile a camera's frames are shown and counted as not used."""

    def show(frame: vision.Frame | vision.Exposure | None, n_shown: int) -> None:
        report_source_events(frames)
        if frame is not None:
            check_size(frame, scene)
        if n_shown:  # for bad input only the error is printed
            status.show(PREPARING)
        if viewer is not None:
            now_s = time.monotonic() if by_itself is not None or isinstance(frames, LiveMarks) else 0.0
            picture = frame if isinstance(frame, vision.Frame) else None
            viewer.prepare(picture, n_shown, now_s if frame is None else frame.exposure_s)

    rehearse = partial(Session, scene, Path(ESTIMATES), print, needle=plan)  # the session writes nothing before a frame
    by_itself = frames if isinstance(frames, Cameras) and not frames.waits else None
    with placed(name, vision.SourceError, InputError):
        session, n_shown = prepared(make, rehearse, by_itself, show)
    session.counters.not_used += n_shown + frames.frames_dropped
    return session


def _report(
    session: Session,
    name: str,
    fault: Exception | None,
    refused: Mapping[str, int] | None,
    recordings: list[Path],
) -> dict[str, Any]:
    """Result of a live run for `--json`: counts of frames, latencies [ms], counts of advice, and the error, if any.

    deadlines_missed: number of frames that newer frames replaced, or whose estimate took longer than a frame interval
    memory_mb: memory of the process after the first frames, and at the end [MB]; None if the system does not report it
    refused: counts of unusable input from a tracker, by kind; None for other sources
    """
    unwritten = next((table.fault for table in session.tables if table.fault is not None), None)
    counters, fault = session.counters, fault or unwritten
    return {
        **counters.numbers,
        "statuses": dict(session.statuses),
        "p50_ms": counters.latencies.quantile_ms(0.5),
        "p99_ms": counters.latencies.quantile_ms(0.99),
        "worst_ms": counters.latencies.worst_ms,
        "memory_mb": [counters.began_mb, memory_mb()],
        "advice": None if session.advice is None else dict(session.advice.counts),
        "refused": refused,
        "recordings": recordings,
        "fault": None if fault is None else f"{name}: {fault}" if fault is not unwritten else str(fault),
    }


def _write(scene: Scene, path: Path) -> None:
    """Write the scene of a run; if that fails, report it and continue."""
    try:
        write_scene(scene, path)
    except InputError as error:
        LOG.warning("%s; the run continues without it", error)


def as_written(scene: Scene) -> Scene:
    """The scene as read back from its file, so that a replay begins with exactly the same scene."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / SCENE
        write_scene(scene, path)
        return read_scene(path)


def _open(
    sources: Sequence[str], scene_path: Path | None, fps: float | None, phantom: PhantomProcess | None
) -> tuple[Scene | None, Frames]:
    if len(sources) == 1 and is_mark_source(sources[0]):
        without_fps(sources[0], fps, "marks")
        return open_mark_source(sources[0], scene_path)
    return open_live(sources, scene_path, fps=fps, phantom=phantom)


def follow(
    session: Session,
    frames: Frames,
    duration_s: float,
    clock: Callable[[], float] = time.monotonic,
    *,
    attend: Callable[[], None] = lambda: None,
) -> None:
    """Process frames as they arrive, and predict while none arrives, until the source ends or duration_s [s] are over.

    attend: called in each cycle of the loop, between two frames
    """
    began, dropped_before = clock(), frames.frames_dropped
    while not frames.ended and clock() - began < duration_s:
        if isinstance(frames, Cameras) and frames.opening:
            began = clock()
        attend()
        asked = time.perf_counter()
        frame = frames.next(session.wait_s)
        waited_s = time.perf_counter() - asked
        session.count_from(frames.origin_s)
        session.counters.dropped = frames.frames_dropped - dropped_before
        report_source_events(frames)
        if isinstance(frames, Cameras):
            session.dated(frames.late_s, uneven=frames.uneven)
        if frame is not None and session.paused:
            session.counters.not_used += 1
            frame = None
        if (frame is None or not session.take(frame, waited_s)) and not frames.ended:
            session.coast(clock())
