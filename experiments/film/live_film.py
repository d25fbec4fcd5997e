"""Films of a live run, written by their own threads; the loop does not wait for them."""

from __future__ import annotations

import shutil
import threading
from pathlib import Path

from estimators import Guidance
from experiments.errors import InputError
from experiments.film.film import write_worst
from experiments.film.overlay import Overlay, drawn
from experiments.film.views import film_cameras, pictures_of
from experiments.film.worst import WorstFrames
from experiments.formats.films.pictures import growing_in
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import FILTER, AnyFrame, Line, Step
from experiments.pipeline.live.recorder_thread import RecorderThread
from experiments.pipeline.recorder import join
from vision import Frame
from vision.arrays import Image

WAITING = 8
"""Largest number of waiting pictures of a camera; one more replaces the oldest; choice: 0.3 s at 30 frames/s."""


class LiveFilm:
    """A film for each camera; a thread for each camera draws and compresses the pictures.

    The films are written in pieces to the folder `growing`, which the first frame creates. At the end the pieces are
    joined; if the run is killed, `softaim record --recover` joins them.
    n_dropped: number of pictures dropped because a thread was too slow; fault: the first error that ended a film
    """

    def __init__(self, scene: Scene, growing: Path, plan: NeedlePlan | None = None) -> None:
        self.growing, self.plan = growing, plan
        self.worst, self._worst_lock = WorstFrames(), threading.Lock()
        self.n_dropped = 0
        self.fault: Exception | None = None
        self.written: list[Path] = []
        self._cameras = film_cameras(scene)
        if growing.exists():
            raise InputError.at(growing, "no folder of an unfinished film", "one; softaim record --recover joins it")
        self._threads = {
            name: RecorderThread(
                growing_in(growing, name),
                "MJPG",
                self._drawn,
                n_waiting=WAITING,
                faults=Exception,  # after any error, the run continues without its film
                failed=self._fail,
            )
            for name in self._cameras
        }

    @property
    def n_written(self) -> int:
        """Number of pictures in the films."""
        return sum(thread.n_recorded for thread in self._threads.values())

    def take(self, frame: AnyFrame, line: Line, step: Step, guidance: Guidance | None = None) -> None:
        """Pass a frame to the threads; a thread that is too slow drops its oldest waiting picture."""
        for name, (image, overlay) in pictures_of(frame, self._cameras, line, step, guidance, self.plan).items():
            self.n_dropped += self._threads[name].make_room()
            self._threads[name].put((step.estimates[FILTER].time_s, image, overlay))

    def finish(self, folder: Path) -> None:
        """Write the waiting pictures, join each film's pieces, move the films to `folder`, and write worst.png."""
        for thread in self._threads.values():
            thread.finish()
        if not self.n_written:
            return
        try:
            try:
                join(self.growing)
            finally:  # films of cameras without a fault
                for path in sorted(self.growing.glob("video.*")):
                    film = folder / path.name.replace("video", "film", 1)
                    shutil.move(path, film)
                    self.written.append(film)
            shutil.rmtree(self.growing)
            write_worst(self.worst, folder)
        except (InputError, OSError) as error:
            self.fault = self.fault or error

    def _drawn(self, taken: tuple[float, Image, Overlay]) -> Frame:
        time_s, image, overlay = taken
        picture = drawn(image, overlay)
        with self._worst_lock:
            self.worst.take(overlay, picture)
        return Frame(self.n_written, time_s, picture)

    def _fail(self, fault: Exception) -> None:
        self.fault = self.fault or fault
