"""Film of a live run, written by its own thread; the loop does not wait for it."""

from __future__ import annotations

import shutil
from pathlib import Path

from estimators import Guidance
from experiments.errors import InputError
from experiments.film.film import FILM, ground, write_worst
from experiments.film.overlay import Overlay, drawn
from experiments.film.views import ground_camera, overlay_of
from experiments.film.worst import WorstFrames
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import FILTER, AnyFrame, Line, Step
from experiments.pipeline.live.recorder_thread import RecorderThread
from experiments.pipeline.recorder import join
from vision import Frame
from vision.arrays import Image

WAITING = 8
"""Largest number of waiting frames, above which the oldest is dropped; choice: about 0.3 s at 30 frames/s."""


class LiveFilm:
    """A film that is written in pieces in its own folder, like a recording, and joined at the end.

    growing: that folder, created with the first frame; after a kill, `softaim record --recover` joins the pieces
    In the loop, `take` only projects; drawing and compression run in the thread.
    State: the thread; number of frames dropped because it was too slow; the fault that ended it; the time of the
    last frame [s], which the next has to exceed.
    """

    def __init__(self, scene: Scene, growing: Path, plan: NeedlePlan | None = None) -> None:
        self.growing, self.plan = growing, plan
        self.camera = scene.cameras[0] if scene.cameras else ground_camera(scene)
        self.worst = WorstFrames()
        self.n_dropped = 0
        self.fault: Exception | None = None
        self._last_s = -float("inf")
        if growing.exists():
            raise InputError.at(growing, "no folder of an unfinished film", "one; softaim record --recover joins it")
        self._thread = RecorderThread(
            growing,
            "MJPG",
            self._drawn,
            n_waiting=WAITING,
            faults=Exception,  # after any error, the run continues without its film
            failed=self._fail,
        )

    @property
    def n_written(self) -> int:
        """Number of frames in the film."""
        return self._thread.n_recorded

    def take(self, frame: AnyFrame, line: Line, step: Step, guidance: Guidance | None = None) -> None:
        """Pass a frame to the thread; the oldest waiting one is dropped if the thread is too slow."""
        time_s = step.estimates[FILTER].time_s
        if self.fault is not None or not round(time_s, 9) > round(self._last_s, 9):
            self.n_dropped += 1
            return
        self._last_s = time_s
        overlay = overlay_of(line, step, line.camera if isinstance(frame, Frame) else self.camera, guidance, self.plan)
        image = frame.image if isinstance(frame, Frame) else ground(self.camera)
        self.n_dropped += self._thread.make_room()
        self._thread.put((time_s, image, overlay))

    def finish(self, folder: Path) -> None:
        """Write waiting frames, join the pieces, and move the film to an existing folder, with worst.png."""
        self._thread.finish()
        if not self.n_written:
            return
        try:
            join(self.growing)
            shutil.move(next(self.growing.glob("video.*")), folder / FILM)
            shutil.rmtree(self.growing)
            write_worst(self.worst, folder)
        except (InputError, OSError) as error:
            self.fault = self.fault or error

    def _drawn(self, taken: tuple[float, Image, Overlay]) -> Frame:
        time_s, image, overlay = taken
        picture = drawn(image, overlay)
        self.worst.take(overlay, picture)
        return Frame(self.n_written, time_s, picture)

    def _fail(self, fault: Exception) -> None:
        self.fault = fault
