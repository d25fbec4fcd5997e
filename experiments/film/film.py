"""Annotated films of a run over a recording: film.avi, or a film for each camera, and worst.png."""

from __future__ import annotations

from pathlib import Path
from typing import Self

import cv2

from estimators import Guidance
from experiments.film.overlay import drawn
from experiments.film.views import film_cameras, pictures_of
from experiments.film.worst import WorstFrames
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.outputs import write_whole
from experiments.formats.recording import Recording
from experiments.pipeline.line import AnyFrame, Line, Step
from experiments.pipeline.recorder import rate_of
from vision import VideoWriter

FILM, WORST = "film.avi", "worst.png"


class Film:
    """A context manager that writes film.avi into a folder frame by frame, and worst.png at the end.

    In space each camera has a film, film.NAME.avi. If there are no pictures, marks are drawn on a plain background.
    Raises InputError for a scene in space without cameras.
    """

    def __init__(self, folder: Path, recording: Recording, plan: NeedlePlan | None = None) -> None:
        self.folder, self.plan = folder, plan
        times_s = {one.camera: one.exposures_s for one in recording.films}
        self._cameras = film_cameras(recording.scene)
        self._fps = {name: rate_of(times_s.get(name, recording.exposures_s)) for name in self._cameras}
        self.worst = WorstFrames()
        self._writers: dict[str, VideoWriter] = {}

    def take(self, frame: AnyFrame, line: Line, step: Step, guidance: Guidance | None = None) -> None:
        """Draw the pictures of a frame, and append each to its camera's film."""
        for name, (image, overlay) in pictures_of(frame, self._cameras, line, step, guidance, self.plan).items():
            picture = drawn(image, overlay)
            if name not in self._writers:
                height, width = picture.shape[:2]
                path = self.folder / (f"film.{name}.avi" if name else FILM)
                self._writers[name] = VideoWriter(path, (width, height), self._fps[name])
            self._writers[name].write(picture)
            self.worst.take(overlay, picture)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        for writer in self._writers.values():
            writer.close() if kind is None else writer.discard()
        if self._writers and kind is None:
            write_worst(self.worst, self.folder)


def write_worst(worst: WorstFrames, folder: Path) -> None:
    """If any frame was drawn, write worst.png to an existing folder."""
    sheet = worst.sheet()
    if sheet is not None:
        write_whole(folder / WORST, cv2.imencode(".png", sheet)[1].tobytes())
