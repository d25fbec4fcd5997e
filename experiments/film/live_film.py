"""The film of a live run, written as frames come: by a thread of its own, which the loop never waits for."""

from __future__ import annotations

import shutil
import threading
from collections import deque
from pathlib import Path

from estimators import Guidance
from experiments.errors import InputError
from experiments.film.film import FILM, ground, write_worst
from experiments.film.overlay import Overlay, drawn
from experiments.film.views import ground_camera, overlay_of
from experiments.film.worst import WorstFrames
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import FILTER, Line, Step
from experiments.pipeline.recorder import PIECE_S, Recorder, join
from vision import Frame
from vision.arrays import Image

WAITING = 8
"""Frames that wait for the thread, at most; then the oldest goes: some 0.3 s at 30 frames/s; chosen."""


class LiveFilm:
    """A film that grows piece by piece in a folder of its own, as a recording does, and is joined at the end.

    growing: that folder, made with the first frame; when the program is killed, `softaim record --recover` joins it
    What `take` costs the loop is the projection of what is to be drawn; drawing and compression are the thread's.
    State: frames that wait; how many were dropped because the thread fell behind, or written; the fault that ended it;
    the time of the last frame [s], which a later one has to exceed.
    """

    def __init__(self, scene: Scene, growing: Path, plan: NeedlePlan | None = None) -> None:
        self.growing, self.plan = growing, plan
        self.camera = scene.cameras[0] if scene.cameras else ground_camera(scene)
        self.worst = WorstFrames()
        self.n_dropped = self.n_written = 0
        self.fault: Exception | None = None
        self._waiting: deque[tuple[float, Image, Overlay]] = deque()
        self._changed = threading.Condition()
        self._ended = False
        self._recorder: Recorder | None = None
        self._last_s = -float("inf")
        if growing.exists():
            raise InputError.at(
                growing, "no such folder, for the film to grow in", "one; softaim record --recover joins it"
            )
        self._thread = threading.Thread(target=self._work, name="film", daemon=True)
        self._thread.start()

    def take(self, frame: Frame | None, line: Line, step: Step, guidance: Guidance | None = None) -> None:
        """Hand a frame to the thread; the oldest that waits is dropped where it falls behind."""
        time_s = step.estimates[FILTER].time_s
        if self.fault is not None or not round(time_s, 9) > round(self._last_s, 9):
            self.n_dropped += 1
            return
        self._last_s = time_s
        overlay = overlay_of(line, step, self.camera, guidance, self.plan)
        image = ground(self.camera) if frame is None else frame.image
        with self._changed:
            if len(self._waiting) == WAITING:
                self._waiting.popleft()
                self.n_dropped += 1
            self._waiting.append((time_s, image, overlay))
            self._changed.notify()

    def finish(self, folder: Path) -> None:
        """Write what waits, join the pieces, and move the film to a folder that exists, with worst.png."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()
        if self._recorder is None:
            return
        try:
            join(self.growing)
            shutil.move(next(self.growing.glob("video.*")), folder / FILM)
            shutil.rmtree(self.growing)
            write_worst(self.worst, folder)
        except (InputError, OSError) as error:
            self.fault = self.fault or error

    def _work(self) -> None:
        try:
            while not self._ended or self._waiting:  # in this order: none comes after the end
                one = self._next()
                if one is not None:
                    self._write(*one)
                elif self._recorder is not None:
                    self._recorder.check()
            if self._recorder is not None:
                self._recorder.finish_piece()
        except Exception as error:  # whatever it is, the run goes on without its film
            self.fault = error

    def _next(self) -> tuple[float, Image, Overlay] | None:
        with self._changed:
            if not self._waiting and not self._ended:
                self._changed.wait(0.1 * PIECE_S)
            return self._waiting.popleft() if self._waiting else None

    def _write(self, time_s: float, image: Image, overlay: Overlay) -> None:
        picture = drawn(image, overlay)
        if self._recorder is None:
            height, width = picture.shape[:2]
            self._recorder = Recorder(self.growing, (width, height), "MJPG")
        self._recorder.take(Frame(self.n_written, time_s, picture))
        self.n_written += 1
        self.worst.take(overlay, picture)
