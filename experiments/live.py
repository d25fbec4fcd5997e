"""The line on frames as they come: what `softaim live` does.

State lives in `Session`: the line, the rows written so far, and what the person is shown.
"""

from __future__ import annotations

import csv
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

import vision
from dynamics import adaptive, pack, unpack
from estimators import MarkMeasurement, TargetEstimate
from experiments.errors import InputError
from experiments.estimate_rows import header, row
from experiments.line import FILTER, Line
from experiments.outputs import output_folder
from experiments.recording import open_recording
from experiments.scenario import Scenario, read_scenario
from experiments.scene import Scene, read_scene
from experiments.simulate import draw, poke_force, scene_of, tremor_force

Floats = NDArray[np.float64]
SMOOTHING = 0.1
"""Share of the newest frame in the running frames per second and latency shown; chosen."""
LAST_CAMERA = 99
"""Greatest camera index: OpenCV takes the hundreds for the number of a programming interface."""


class Capture(Protocol):
    """What a source of frames must do, as cv2.VideoCapture does."""

    def read(self) -> tuple[bool, NDArray[np.uint8] | None]:
        """Wait for the next frame; False at the end."""

    def release(self) -> None:
        """Let go of the device."""


class PhantomCamera:
    """A camera before the poked phantom, moved by SciPy's DOP853 in real time and drawn as asked for.

    State: the phantom's state (n_state,) at time_s since the camera was opened.
    """

    def __init__(self, scenario: Scenario, *, hours: float = 1.0) -> None:
        self.scenario = scenario
        self.scene = scene_of(scenario)
        self._rng = np.random.default_rng(scenario.seed)
        network, duration_s = self.scene.network, 3600.0 * hours
        self._forces = [tremor_force(network, scenario.tremor, duration_s, self._rng)] if scenario.tremor else []
        if scenario.pokes:
            self._forces.append(poke_force(network, scenario.pokes, duration_s, self._rng))
        rest = network.positions[network.free]
        self._state = pack(rest, np.zeros_like(rest))
        self._strays = vision.distractors(
            scenario.camera.distractors, self.scene.cameras[0].size_px, self._rng, [scenario.marks.hue_deg]
        )
        self._lighting = vision.Lighting()
        self._end_s = duration_s
        self._opened = time.monotonic()
        self.time_s = 0.0

    def read(self) -> tuple[bool, NDArray[np.uint8] | None]:
        """The frame due next, or the one due now if drawing fell behind."""
        interval = self.scenario.frame_interval_s
        due = self.time_s + interval
        late = time.monotonic() - self._opened - due
        if late < 0:
            time.sleep(-late)
        else:
            due += interval * np.floor(late / interval)
        if due >= self._end_s:
            return False, None
        self._move(due)
        network = self.scene.network
        positions = network.positions.copy()
        positions[network.free] = unpack(self._state, network.dim)[0]
        return True, draw(self.scene, positions, self._lighting, self._rng, strays=self._strays)

    def _move(self, due: float) -> None:
        nothing = np.zeros((len(self.scene.network.free), self.scene.network.dim))
        self._state = adaptive(
            self.scene.network,
            self._state,
            [self.time_s, due],
            force=lambda t: sum((force(t) for force in self._forces), nothing),
            rtol=1e-5,
            atol=1e-8,
            max_step_s=1.0 / 60.0,
        )[-1]
        self.time_s = due

    def release(self) -> None:
        """Nothing to let go of."""


class RecordingCamera:
    """A recording played at its own pace. State: the frames still to come, when the first was shown."""

    def __init__(self, folder: Path) -> None:
        recording = open_recording(folder)
        if recording.marks is not None:
            raise InputError(
                f"{folder}: expected a recording with a video, found marks.csv, which has no frames to show"
            )
        self.scene = recording.scene
        self._frames = recording.open_frames()
        self._coming = iter(self._frames)
        self._began: float | None = None
        self._first_s = float(recording.exposures_s[0])

    def read(self) -> tuple[bool, NDArray[np.uint8] | None]:
        """The next frame, when it is due."""
        frame = next(self._coming, None)
        if frame is None:
            return False, None
        if self._began is None:
            self._began = time.monotonic()
        wait = self._began + frame.exposure_s - self._first_s - time.monotonic()
        if wait > 0:
            time.sleep(wait)
        return True, frame.image

    def release(self) -> None:
        """Close the video."""
        self._frames.close()


def open_source(source: str, scene_path: Path | None) -> tuple[Scene, vision.LiveFrames]:
    """Scene and frames of what --source names: phantom, a recording, a film, a camera index. Raises InputError."""
    if source == "phantom":
        phantom = PhantomCamera(read_scenario("webcam"))
        return phantom.scene, vision.LiveFrames(lambda: phantom)
    path = Path(source)
    if path.is_dir():
        camera = RecordingCamera(path)
        scene = camera.scene if scene_path is None else _filmed_scene(scene_path)
        return scene, vision.LiveFrames(lambda: camera)
    if scene_path is None:
        raise InputError(f"--source {source}: expected --scene scene.toml beside a camera or a film, found none")
    scene = _filmed_scene(scene_path)
    if source.isdecimal():
        if int(source) > LAST_CAMERA:
            raise InputError(f"--source {source}: expected a camera index from 0 to {LAST_CAMERA}, found more")
        return scene, vision.LiveFrames(lambda: cv2.VideoCapture(int(source)))
    if not path.is_file():
        raise InputError(
            f"--source {source}: expected phantom, a camera index, a film or a recording, found none of them"
        )
    return scene, vision.LiveFrames(lambda: cv2.VideoCapture(str(path)), paced=True)


def _filmed_scene(path: Path) -> Scene:
    scene = read_scene(path)
    if not scene.cameras:
        raise InputError(f"{path}: camera: expected one, found none")
    return scene


class Session:
    """One live run. State: the line, rows of estimates.csv written so far, frames and statuses counted."""

    def __init__(self, scene: Scene, rows: Path, show: Callable[[str], None]) -> None:
        _warm_up(scene)
        self.line = Line(scene, baseline=False)
        self.n_frames = 0
        self.statuses: Counter[str] = Counter()
        self.latencies_ms: list[float] = []
        self._show = show
        self._file = rows.open("w", encoding="utf-8", newline="")
        self._csv = csv.writer(self._file)
        self._csv.writerow(header(scene.network.dim))
        self._fps: float | None = None
        self._last_s: float | None = None

    def take(self, frame: vision.Frame) -> None:
        """Estimate, write and show one frame; InputError where it is not of the size that the scene's camera gives."""
        height, width = frame.image.shape[:2]
        size_px = self.line.scene.cameras[0].size_px
        if size_px != (width, height):
            raise InputError(
                f"scene: camera[0].size_px: expected [{width}, {height}], as the frames have, found {list(size_px)}"
            )
        estimate = self.line.see(frame.exposure_s, frame.image).estimates[FILTER]
        self._csv.writerow(row(estimate))
        self._file.flush()
        latency_ms = 1e3 * (time.monotonic() - frame.exposure_s)
        self.latencies_ms.append(latency_ms)
        self.statuses[str(estimate.status)] += 1
        self.n_frames += 1
        if self._last_s is not None:
            now = 1.0 / max(frame.exposure_s - self._last_s, 1e-6)
            self._fps = now if self._fps is None else (1.0 - SMOOTHING) * self._fps + SMOOTHING * now
        self._last_s = frame.exposure_s
        self._show(told(estimate, self._fps, latency_ms))

    def close(self) -> None:
        """End the table."""
        self._file.close()


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


def told(estimate: TargetEstimate, fps: float | None, latency_ms: float) -> str:
    """The line that renews itself: time, target, sigma, status, frames per second, latency."""
    place = ", ".join(f"{1e3 * x:7.2f}" for x in estimate.mean)
    sigma = np.nan if estimate.cov is None else 1e3 * np.sqrt(np.linalg.eigvalsh(estimate.cov)[-1])
    rate = "  – " if fps is None else f"{fps:4.0f}"
    return (
        f"{estimate.time_s:10.2f} s  target ({place}) mm  sigma {sigma:5.2f} mm  {estimate.status:<8}"
        f"  {rate} frames/s  latency {latency_ms:5.1f} ms"
    )


def live(
    source: str, scene_path: Path | None, out: Path | None, *, duration_s: float | None = None, force: bool = False
) -> None:
    """Follow the target until the source ends, the duration is over or Ctrl-C; then write estimates.csv.

    Rows are written as they come, in a folder beside `out` that takes its name at the end. Raises InputError.
    """
    folder_path = out if out is not None else Path(time.strftime("live-%Y%m%d-%H%M%S"))
    scene, frames = open_source(source, scene_path)
    fault: Exception | None = None
    with output_folder(folder_path, force=force) as folder, frames, status_line() as show:
        session = Session(scene, folder / "estimates.csv", show)
        began = time.monotonic()
        try:
            for frame in frames:
                session.take(frame)
                if duration_s is not None and time.monotonic() - began >= duration_s:
                    break
        except KeyboardInterrupt:
            pass  # Ctrl-C is how a live run ends
        except (vision.SourceError, InputError) as error:
            if not session.n_frames:
                raise InputError(f"--source {source}: {error}") from error
            fault = error  # what was estimated until then is kept
        finally:
            session.close()
        if not session.n_frames:
            raise InputError(f"--source {source}: expected frames, found none")
    counted = ", ".join(f"{n} {status}" for status, n in session.statuses.items())
    print(
        f"{session.n_frames} frames ({counted}), {frames.frames_dropped} dropped; "
        f"latency median {np.median(session.latencies_ms):.1f} ms, worst {max(session.latencies_ms):.1f} ms"
    )
    print(f"Estimates in {folder_path / 'estimates.csv'}")
    if fault is not None:
        raise InputError(f"--source {source}: {fault}")


@contextmanager
def status_line() -> Iterator[Callable[[str], None]]:
    """Show one line that renews itself on a terminal; elsewhere a line about once a second."""
    terminal = sys.stdout.isatty()
    last = -np.inf

    def show(text: str) -> None:
        nonlocal last
        if terminal:
            sys.stdout.write(f"\r{text}\x1b[K")
            sys.stdout.flush()
        elif time.monotonic() - last >= 1.0:
            last = time.monotonic()
            print(text, flush=True)

    try:
        yield show
    finally:
        if terminal:
            sys.stdout.write("\n")
