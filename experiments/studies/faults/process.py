"""A live run on a simulated film, with a separate process, a terminal and viewers."""

from __future__ import annotations

import contextlib
import os
import re
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Self

import numpy as np

from experiments.errors import InputError
from experiments.formats.recording import read_recording
from experiments.formats.scene.scene import Scene, write_scene
from experiments.formats.tables import read_rows
from experiments.pipeline.live.journal import JOURNAL, Act, read_journal
from experiments.pipeline.live.session import ADVICE, ESTIMATES
from experiments.pipeline.recorder import Recorder, join
from experiments.studies.faults.scripted import plan_of
from experiments.studies.faults.viewer import Viewer
from experiments.studies.faults.world import Motion, drawn, scenario_of, scene_in_view, undisturbed
from vision import Frame, SourceError

FRAME_S = 0.05
"""Frame interval of the film [s]: so long that a busy machine can show and record all frames in real time."""
STARTS_S = 60.0
"""Time limit for the appearance of a run's page [s]: longer than any run needs."""
ENDING_S = 0.5
"""If the rest of the film is shorter than this [s], the run is not interrupted: it ends with the film."""
ENDS_S = 20.0
"""Time limit for the end of the run's main process [s], counted from Ctrl-C or from the end of the film."""
SOFTAIM = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    "from experiments.commands.app import main; main()"
)
"""The program of the run's process. It enables Ctrl-C, which a background process ignores by default."""
GONE_S = 3.0
"""Time limit from the end of the run's main process to the end of its other processes [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Film:
    """A recording of a breathing phantom, its needle file, its scene, and its true motion."""

    folder: Path
    needle: Path
    scene: Scene
    motion: Motion

    @property
    def ends_s(self) -> float:
        """Time of the last frame [s]."""
        return float(self.motion.times_s[-1]) - FRAME_S


@cache
def _films() -> tempfile.TemporaryDirectory[str]:
    """Temporary folder of the films; it is deleted when this process ends."""
    return tempfile.TemporaryDirectory(prefix="softaim-films-")


@cache
def filmed(seed: int, duration_s: int) -> Film:
    """Film the phantom for `duration_s` [s]; cached, because most faults use the same films."""
    folder = Path(tempfile.mkdtemp(dir=_films().name))
    scenario = scenario_of(seed, duration_s)
    scene = scene_in_view(scenario)
    motion = undisturbed(seed, duration_s)
    rng = np.random.default_rng([seed, 7])
    film = folder / "film"
    recorder = Recorder(film, scene.cameras[0].size_px, "MJPG")
    for k in range(round(duration_s / FRAME_S)):
        recorder.take(Frame(k, k * FRAME_S, drawn(scene, motion.at(k * FRAME_S), rng)))
    recorder.finish_piece()
    join(film)
    write_scene(scene, film / "scene.toml")
    plan = plan_of(scene)
    needle = folder / "needle.toml"
    entry, direction = (1e3 * plan.insertion.entry).tolist(), plan.insertion.axis.tolist()
    needle.write_text(
        f"version = 1\nentry_mm = {entry}\ndirection = {direction}\nspeed_mm_s = {1e3 * plan.insertion.speed_m_s}\n"
        f"[lesion]\nradius_mm = {1e3 * plan.lesion.axes[0, 0]}\n"
        f"[advice]\ngo = {plan.settings.go}\nworth = {plan.settings.worth}\n",
        encoding="utf-8",
    )
    return Film(film, needle, scene, motion)


class Terminal:
    """Reads the output of a process in a thread.

    text: the output that has been read so far; read: if false, the thread pauses
    """

    def __init__(self, *sources: int) -> None:
        self.text = ""
        self.read = True
        self._sources = list(sources)
        self._closing = False
        self._thread = threading.Thread(target=self._work, name="terminal", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop reading, and close the file descriptors."""
        self._closing = True
        self._thread.join()

    def _work(self) -> None:
        while self._sources and not self._closing:
            if not self.read:
                time.sleep(0.01)
                continue
            for source in select.select(self._sources, [], [], 0.05)[0]:
                try:
                    found = os.read(source, 65536)
                except OSError:  # the other end of a terminal is gone
                    found = b""
                self.text += found.decode("utf-8", "replace")
                if not found:
                    self._sources.remove(source)
                    os.close(source)
        for source in self._sources:
            os.close(source)


@dataclass(slots=True, eq=False)
class LiveRun:
    """A process that runs `softaim live --record` on a film, with a needle.

    folder: existing folder for the output; options: further options of the command
    on_terminal: whether the output goes to a terminal; otherwise it goes to pipes
    igtl_port: port of the OpenIGTLink server, 0 for none
    process: the process; terminal: the reader of its output; address: port and token of its page
    viewer: the viewer that is always connected; others: further viewers; held: resources to release at the end
    """

    film: Film
    folder: Path
    options: list[str] = field(default_factory=lambda: ["--page", "127.0.0.1:0"])
    on_terminal: bool = False
    igtl_port: int = 0
    held: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)
    others: list[Viewer] = field(default_factory=list)
    process: subprocess.Popen[bytes] = field(init=False)
    terminal: Terminal = field(init=False)
    address: tuple[int, str] = field(init=False)
    viewer: Viewer = field(init=False)
    _killed: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)

    def __enter__(self) -> Self:
        """Enter a context. When the context ends, the process is killed and all resources are released."""
        return self

    def __exit__(self, *_: object) -> None:
        self._killed.close()
        self.held.close()

    @property
    def out(self) -> Path:
        """The folder of the run's tables."""
        return self.folder / "live"

    def start(self) -> bool:
        """Start the process, and connect a viewer to its page. Returns whether the page appeared."""
        command = [sys.executable, "-c", SOFTAIM, "live", "--source", str(self.film.folder)]
        command += ["--needle", str(self.film.needle), "--out", str(self.out), "--record", *self.options]
        theirs, mine = self._ends()
        self.process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=theirs[0], stderr=theirs[1], start_new_session=True
        )
        for end in set(theirs):
            os.close(end)
        self.terminal = Terminal(*mine)
        self.held.callback(self.terminal.close)
        self._killed.callback(self._kill)
        until = time.monotonic() + STARTS_S
        while self.process.poll() is None and time.monotonic() < until:
            if found := re.search(r"page: http://127\.0\.0\.1:(\d+)/#token=([\w-]+)\s", self.terminal.text):
                self.address = int(found[1]), found[2]
                self.viewer = self.watched()
                return True
            time.sleep(0.01)
        return False

    def _kill(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def _ends(self) -> tuple[tuple[int, int], list[int]]:
        """File descriptors to which the process writes output and errors, and descriptors from which we read them."""
        if self.on_terminal:
            mine, theirs = os.openpty()
            return (theirs, theirs), [mine]
        (out, to_out), (err, to_err) = os.pipe(), os.pipe()
        return (to_out, to_err), [out, err]

    def watched(self, pause_s: float = 0.0) -> Viewer:
        """Connect a viewer that shows each state for pause_s [s]; returns the viewer."""
        scene = self.film.scene
        target, n_measured = scene.network.index(scene.target.node), len(scene.measured_nodes)
        viewer = Viewer(self.address[0], self.film.motion, target, n_measured, pause_s=pause_s)
        self.held.callback(viewer.close)
        return viewer

    def stop(self) -> float:
        """Send Ctrl-C unless the film ends soon; returns the film time at which the evaluated period ends [s].

        If the process has ended before the film, the result is inf.
        """
        now_s = self.viewer.now_s
        if self.process.poll() is None and now_s < self.film.ends_s - ENDING_S:
            self.process.send_signal(signal.SIGINT)
        elif now_s < self.film.ends_s:
            return np.inf
        return min(now_s, self.film.ends_s)

    def ended(self) -> str:
        """Wait until the process ends. Returns a text with its exit code, or with the signal that ended it."""
        process = self.process
        try:
            code = process.wait(ENDS_S)
        except subprocess.TimeoutExpired:
            return "does not end"
        how = f"exit {code}" if code >= 0 else f"ended by {signal.Signals(-code).name}"
        until = time.monotonic() + GONE_S
        while self._is_left() and time.monotonic() < until:
            time.sleep(0.02)
        return f"{how}, processes left" if self._is_left() else how

    def _is_left(self) -> bool:
        try:
            os.killpg(self.process.pid, 0)
        except ProcessLookupError:
            return False
        return True

    def lacks_s(self, until_s: float) -> float:
        """Time from the end of the stored data to the last frame that the viewer showed before the time until_s [s].

        If the data cannot be read, the time begins at the first frame that the viewer showed.
        """
        shown_s = [time_s for now_s, time_s in self.viewer.known_s if now_s <= until_s]
        if not shown_s:
            return 0.0
        try:
            kept_s = min(self._kept_s())
        except (InputError, SourceError, ValueError):  # also for a table without rows
            kept_s = shown_s[0]
        return max(shown_s[-1] - kept_s, 0.0)

    def _kept_s(self) -> list[float]:
        """Film times of the last row in each table, and of the last recorded picture [s]."""
        (recording,) = self.out.glob("recording-*")
        tables = [folder / name for folder in (self.out, recording) for name in (ESTIMATES, ADVICE)]
        origins = [done.time_s for done in read_journal(recording / JOURNAL) if done.act is Act.ORIGIN]
        seen = read_recording(recording)
        with seen.open_frames() as frames:
            last = max(frame.exposure_s for frame in frames)
        return [_last_s(one) for one in tables] + [last - (origins[-1] if origins else 0.0)]


def _last_s(table: Path) -> float:
    """The time of a table's last complete row [s]. Raises InputError, ValueError."""
    rows = read_rows(table, "the table of a live run", torn=True)
    column = next(rows).index("time_s")
    return max(float(row[column]) for row in rows)
