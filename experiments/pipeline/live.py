"""The line on frames as they come: what `softaim live` does.

State lives in `Session`: the line, the rows written so far, and what the person is shown.
"""

from __future__ import annotations

import csv
import shutil
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

import vision
from estimators import Guidance, MarkMeasurement, TargetEstimate, after_frame
from experiments.errors import InputError
from experiments.formats.estimate_rows import header, row
from experiments.formats.needle_file import NeedlePlan, read_needle
from experiments.formats.outputs import output_folder
from experiments.formats.scene.scene import Scene
from experiments.pipeline.events import tell_events, tell_swap
from experiments.pipeline.frame_sources import open_source
from experiments.pipeline.line import FILTER, Line
from experiments.pipeline.live_advice import LiveAdvice, words
from vision.detection.rim_search import detect_by_rim
from vision.tracking.appearance import AppearanceModel

SMOOTHING = 0.1
"""Share of the newest frame in the running frames per second and latency shown; chosen."""
COAST_S = 0.1
"""How long a frame is waited for before the target is told without one [s]; chosen."""
BEHIND_S, BEHIND_FRAMES = 0.25, 2.0
"""The filter goes on without a frame that is late by so long [s] and so many frame intervals; chosen."""
ADVICE = "advice.csv"
UNKNOWN_S = 2.0
"""By so long before two frames told the interval: a slow camera's must not always be late; chosen."""


class Session:
    """One live run.

    needle: what advice is given on, None where none is asked for; advice.csv stands beside the rows of estimates
    State: the line, rows of estimates.csv written so far; frames, statuses, rows without a frame, late frames counted;
    the advice.
    """

    def __init__(
        self,
        scene: Scene,
        rows: Path,
        show: Callable[[str], None],
        *,
        needle: NeedlePlan | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        _warm_up(scene)
        self.line = Line(scene, baseline=False)
        self.advice = None if needle is None else LiveAdvice(needle, self.line.filter, rows.with_name(ADVICE))
        self._clock = clock
        self.n_frames = self.n_coasted = self.n_unused = 0
        self.statuses: Counter[str] = Counter()
        self.latencies_ms: list[float] = []
        self._show = show
        self._file = rows.open("w", encoding="utf-8", newline="")
        self._csv = csv.writer(self._file)
        self._csv.writerow(header(scene.network.dim))
        self._fps: float | None = None
        self._last_s: float | None = None

    def take(self, frame: vision.Frame) -> bool:
        """Estimate, write and show one frame; whether it could be used.

        A frame older than what was told without it cannot, nor one of a size that the scene's camera does not give.
        Raises InputError where the first frame has another size.
        """
        height, width = frame.image.shape[:2]
        size_px = self.line.scene.cameras[0].size_px
        if size_px != (width, height) and not self.n_frames:
            raise InputError(
                f"scene: camera[0].size_px: expected [{width}, {height}], as the frames have, found {list(size_px)}"
            )
        if self._last_s is not None:
            now = 1.0 / max(frame.exposure_s - self._last_s, 1e-6)
            self._fps = now if self._fps is None else (1.0 - SMOOTHING) * self._fps + SMOOTHING * now
        self._last_s = frame.exposure_s
        told_s = self.line.filter.time_s
        if size_px != (width, height) or (told_s is not None and frame.exposure_s < told_s):
            self.n_unused += 1
            return False
        step = self.line.see(frame.exposure_s, frame.image)
        if step.swap is not None:
            tell_swap(step.swap)
        estimate = step.estimates[FILTER]
        self._write(estimate)
        said = None if self.advice is None else self.advice.seen(self.line.filter, estimate, self._clock())
        latency_ms = 1e3 * (self._clock() - frame.exposure_s)
        self.latencies_ms.append(latency_ms)
        self.n_frames += 1
        self._show(told(estimate, self._fps, latency_ms, said))
        return True

    def coast(self, now_s: float) -> None:
        """Show where the target is by now [s] though no frame came.

        The filter itself stays behind, for a frame may yet come; what it goes through without one is written.
        """
        tissue = self.line.filter
        if tissue.time_s is None or self._last_s is None:
            self._show("no frame yet")
            return
        behind_s = now_s - (UNKNOWN_S if self._fps is None else BEHIND_S + BEHIND_FRAMES / self._fps)
        if behind_s > tissue.time_s:
            self._write(self.line.take(behind_s, []).estimates[FILTER])
            self.n_coasted += 1
        if now_s > tissue.time_s:
            status = after_frame(tissue.health, now_s, None, 0, tissue.settings).status
            ahead = replace(tissue.predict_at(now_s), status=status)
            said = None if self.advice is None else self.advice.unseen(tissue, now_s)
            self._show(told(ahead, self._fps, 1e3 * (now_s - self._last_s), said))

    def _write(self, estimate: TargetEstimate) -> None:
        self._csv.writerow(row(estimate))
        self._file.flush()
        self.statuses[str(estimate.status)] += 1

    def close(self) -> None:
        """End the tables."""
        self._file.close()
        if self.advice is not None:
            self.advice.close()

    @property
    def wait_s(self) -> float:
        """How long a frame is waited for before the target is told without one [s]: not until advice is stale."""
        return COAST_S if self.advice is None else min(COAST_S, self.advice.plan.settings.stale_s)


def _warm_up(scene: Scene) -> None:
    """Load what is compiled and cached before the first frame has to wait for it."""
    line, camera = Line(scene, baseline=False), scene.cameras[0]
    positions = scene.network.positions[[scene.network.index(node) for node in scene.measured_nodes]]
    plain = np.eye(scene.network.dim)
    marks = [MarkMeasurement(node, x, 1e-6 * plain) for node, x in zip(scene.measured_nodes, positions, strict=True)]
    for k in range(2):
        line.take(k / 30.0, marks)
    discs = [vision.Disc(center, (8.0, 8.0), scene.marks[0].hue_deg) for center in camera.project(positions)]
    image = vision.draw_frame(camera.size_px, discs, vision.Lighting(), np.random.default_rng(0))
    line.see(3 / 30.0, image)
    one = vision.Expected("", np.array([60.0, 60.0]), np.eye(2), 0.0, vision.Outline(8.0 * np.eye(2), 0.05))
    look = AppearanceModel(0.0)
    look.remember(image, one.center_px, vision.Outline(8.0 * np.eye(2), 0.05))
    for another in (False, True):
        look.place(image, one, another=another)
    detect_by_rim(image, one)


def told(estimate: TargetEstimate, fps: float | None, latency_ms: float, said: Guidance | None = None) -> str:
    """The line that renews itself: time, target, sigma, status, frames per second, latency.

    With advice: time, status, latency, sigma, and the advice.
    """
    place = ", ".join(f"{1e3 * x:7.2f}" for x in estimate.mean)
    sigma = np.nan if estimate.cov is None else 1e3 * np.sqrt(np.linalg.eigvalsh(estimate.cov)[-1])
    if said is not None:
        ms = f"{latency_ms:4.0f} ms"
        return f"{estimate.time_s:10.2f} s  {estimate.status:<8} {ms}  sigma {sigma:.2f} mm  {words(said)}"
    rate = "  – " if fps is None else f"{fps:4.0f}"
    return (
        f"{estimate.time_s:10.2f} s  target ({place}) mm  sigma {sigma:5.2f} mm  {estimate.status:<8}"
        f"  {rate} frames/s  latency {latency_ms:5.1f} ms"
    )


def live(
    source: str,
    scene_path: Path | None,
    out: Path | None,
    *,
    duration_s: float | None = None,
    fps: float | None = None,
    needle_path: Path | None = None,
    force: bool = False,
) -> None:
    """Follow the target until the source ends, the duration is over or Ctrl-C; then write estimates.csv.

    Rows are written as they come, in a folder beside `out` that takes its name at the end. While no frame comes the
    target is predicted; what happens to the source is told on standard error. With a needle's file there is advice on
    it, too, in the line that is shown and in advice.csv. Raises InputError.
    """
    folder_path = out if out is not None else Path(time.strftime("live-%Y%m%d-%H%M%S"))
    name = f"--source {vision.shown_source(source)}"
    scene, frames = open_source(source, scene_path, live=True, fps=fps)
    fault: Exception | None = None
    with frames:
        if scene is None:
            raise InputError.at(name, "--scene scene.toml beside it", "none")
        plan = None if needle_path is None else read_needle(needle_path, scene.target.radius_m, scene.network.dim)
        with output_folder(folder_path, force=force) as folder, status_line() as show:
            session = Session(scene, folder / "estimates.csv", show, needle=plan)
            try:
                follow(session, frames, np.inf if duration_s is None else duration_s)
            except KeyboardInterrupt:
                pass  # Ctrl-C is how a live run ends
            except (vision.SourceError, InputError) as error:
                if not session.n_frames:
                    raise InputError(f"{name}: {error}") from error
                fault = error  # what was estimated until then is kept
            finally:
                tell_events(frames)
                session.close()
            if not session.n_frames:
                raise InputError.at(name, "frames", "none")
    counted = ", ".join(f"{n} {status}" for status, n in session.statuses.items())
    print(
        f"{session.n_frames} frames and {session.n_coasted} moments without one ({counted}), "
        f"{frames.frames_dropped} dropped, {session.n_unused} not used; "
        f"latency median {np.median(session.latencies_ms):.1f} ms, worst {max(session.latencies_ms):.1f} ms"
    )
    print(f"Estimates in {folder_path / 'estimates.csv'}")
    if session.advice is not None:
        said = ", ".join(f"{name} {n}" for name, n in session.advice.counts.items())
        print(f"Advice in {folder_path / ADVICE}: {said}")
    if fault is not None:
        raise InputError(f"{name}: {fault}")


def follow(
    session: Session, frames: vision.Source, duration_s: float, clock: Callable[[], float] = time.monotonic
) -> None:
    """Take frames as they come, and coast where none does, until they end or for so long [s] by their clock."""
    began = clock()
    while not frames.ended and clock() - began < duration_s:
        frame = frames.next(session.wait_s)
        tell_events(frames)
        if (frame is None or not session.take(frame)) and not frames.ended:
            session.coast(clock())


@contextmanager
def status_line() -> Iterator[Callable[[str], None]]:
    """Show one line that renews itself on a terminal; elsewhere a line about once a second."""
    terminal = sys.stdout.isatty()
    last = -np.inf

    def show(text: str) -> None:
        nonlocal last
        if terminal:
            sys.stdout.write(f"\r{text[: shutil.get_terminal_size().columns - 1]}\x1b[K")
            sys.stdout.flush()
        elif time.monotonic() - last >= 1.0:
            last = time.monotonic()
            print(text, flush=True)

    try:
        yield show
    finally:
        if terminal:
            sys.stdout.write("\n")
