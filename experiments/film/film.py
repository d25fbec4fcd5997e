"""Annotated films of a run over a recording: film.avi or one for each camera, and worst.png."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from estimators import Guidance
from experiments.film.overlay import Overlay, drawn
from experiments.film.views import ground_camera, overlay_of
from experiments.film.worst import WorstFrames
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.outputs import write_whole
from experiments.formats.recording import Recording
from experiments.pipeline.line import AnyFrame, Line, Step
from experiments.pipeline.recorder import rate_of
from vision import Exposure, PlaneCamera, VideoWriter
from vision.arrays import Image

FILM, WORST = "film.avi", "worst.png"
GROUND = 60
"""Grey level of the plain background."""


class Film:
    """Writes film.avi into a folder frame by frame, and worst.png at its end; as a context manager.

    In space each camera has a film, film.NAME.avi. Marks of another tracker are drawn on a plain background;
    InputError for those in space.
    State: the writer of each camera, begun with its first frame; the worst frames.
    """

    def __init__(self, folder: Path, recording: Recording, plan: NeedlePlan | None = None) -> None:
        self.folder, self.plan, scene = folder, plan, recording.scene
        films = {one.camera: one.exposures_s for one in recording.films} or {"": recording.exposures_s}
        self._fps = {name: rate_of(exposures_s) for name, exposures_s in films.items()}
        self._cameras = {camera.name: camera for camera in scene.space_cameras}
        self._ground = ground_camera(scene) if recording.source is None and not recording.films else None
        self.worst = WorstFrames()
        self._writers: dict[str, VideoWriter] = {}

    def take(self, frame: AnyFrame, line: Line, step: Step, guidance: Guidance | None = None) -> None:
        """Draw a frame and append it to the film, or the pictures of several cameras to theirs."""
        if isinstance(frame, Exposure):
            for name, image in frame.images.items():
                self._draw(name, image, overlay_of(line, step, self._cameras[name], guidance, self.plan))
            return
        camera = self._ground or line.camera
        image = ground(camera) if frame is None else frame.image
        self._draw("", image, overlay_of(line, step, camera, guidance, self.plan))

    def _draw(self, name: str, image: Image, overlay: Overlay) -> None:
        picture = drawn(image, overlay)
        if name not in self._writers:
            height, width = picture.shape[:2]
            path = self.folder / (f"film.{name}.avi" if name else FILM)
            self._writers[name] = VideoWriter(path, (width, height), self._fps[name])
        self._writers[name].write(picture)
        self.worst.take(overlay, picture)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for writer in self._writers.values():
            writer.close() if kind is None else writer.discard()
        if self._writers and kind is None:
            write_worst(self.worst, self.folder)


def ground(camera: PlaneCamera) -> Image:
    """The plain background for marks without pictures."""
    return np.full((camera.size_px[1], camera.size_px[0], 3), GROUND, dtype=np.uint8)


def write_worst(worst: WorstFrames, folder: Path) -> None:
    """Write worst.png to an existing folder, if there was any frame."""
    sheet = worst.sheet()
    if sheet is not None:
        write_whole(folder / WORST, cv2.imencode(".png", sheet)[1].tobytes())
