"""Annotated films of a run over a recording: film.avi, and worst.png."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from estimators import Guidance
from experiments.film.overlay import drawn
from experiments.film.views import ground_camera, overlay_of
from experiments.film.worst import WorstFrames
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.outputs import write_whole
from experiments.formats.recording import Recording
from experiments.pipeline.line import Line, Step
from experiments.pipeline.recorder import rate_of
from vision import Frame, PlaneCamera, VideoWriter
from vision.arrays import Image

FILM, WORST = "film.avi", "worst.png"
GROUND = 60
"""Grey level of the plain background."""


class Film:
    """Writes film.avi into a folder frame by frame, and worst.png at its end; as a context manager.

    Marks of another tracker are drawn on a plain background; InputError for marks in space.
    State: the writer, begun with the first frame; the worst frames.
    """

    def __init__(self, folder: Path, recording: Recording, plan: NeedlePlan | None = None) -> None:
        self.folder, self.plan = folder, plan
        self.fps = rate_of(recording.exposures_s)
        scene = recording.scene
        self.camera: PlaneCamera = scene.cameras[0] if recording.source is not None else ground_camera(scene)
        self.worst = WorstFrames()
        self._writer: VideoWriter | None = None

    def take(self, frame: Frame | None, line: Line, step: Step, guidance: Guidance | None = None) -> None:
        """Draw a frame and append it to the film."""
        overlay = overlay_of(line, step, self.camera if frame is None else line.camera, guidance, self.plan)
        picture = drawn(ground(self.camera) if frame is None else frame.image, overlay)
        if self._writer is None:
            height, width = picture.shape[:2]
            self._writer = VideoWriter(self.folder / FILM, (width, height), self.fps)
        self._writer.write(picture)
        self.worst.take(overlay, picture)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is None:
            return
        if kind is None:
            self._writer.close()
            write_worst(self.worst, self.folder)
        else:
            self._writer.discard()


def ground(camera: PlaneCamera) -> Image:
    """The plain background for marks without pictures."""
    return np.full((camera.size_px[1], camera.size_px[0], 3), GROUND, dtype=np.uint8)


def write_worst(worst: WorstFrames, folder: Path) -> None:
    """Write worst.png to an existing folder, if there was any frame."""
    sheet = worst.sheet()
    if sheet is not None:
        write_whole(folder / WORST, cv2.imencode(".png", sheet)[1].tobytes())
