"""Animated picture of the README: the scenario `poked`, a needle with advice, and a close-up of the target.

`python -m experiments.studies.readme.moving_picture` in the checkout writes docs/images/poked-advice.webp within a
minute. It needs OpenCV 4.12 or newer.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from estimators import AdviceSettings, Guidance, Insertion, Lesion, Needle
from experiments.film.overlay import LIGHT, drawn, sketched
from experiments.film.strokes import draw_line, draw_text
from experiments.film.views import overlay_of
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.outputs import write_whole
from experiments.formats.recording import read_recording
from experiments.formats.scenario import Camera, Scenario, read_scenario
from experiments.pipeline.advise import advise
from experiments.pipeline.line import FILTER, AnyFrame, Line, Step
from experiments.simulation.simulate import simulate
from vision import Frame, PlaneCamera
from vision.arrays import Image

PICTURE = Path(__file__).parents[3] / "docs" / "images" / "poked-advice.webp"
SIZE_PX, WHOLE, WHOLE_AT_PX = (720, 440), 2.0, (205.0, 245.0)
"""Size of the picture [px], factor by which the film is enlarged, and pixel that shows the target at rest; choice."""
NEAR_PX, NEAR, NEAR_CORNER_PX = (270, 360), 10.0, (440, 60)
"""Close-up of the target: its size [px], its enlargement, and the pixel of its upper left corner; choice."""
SHOWN_S, SLOWER, QUALITY = (5.0, 7.2), 2, 50
"""Times of the first and last frame [s], slow-motion factor, quality of WebP; choice."""
SCENARIO = read_scenario("poked").model_copy(
    update={
        "camera": Camera(size_px=[640, 480], mm_per_px=[2.5, 2.5], calibration_sd_px=0.68),  # in good light
        "duration_s": 10.0,
    }
)
ALONG = np.array([0.5, -1.0]) / np.hypot(0.5, -1.0)
PLAN = NeedlePlan(Needle(), Insertion(np.array([-0.025, 0.24]), ALONG, 0.4), Lesion.ball(0.010, 2), AdviceSettings())


class Watched:
    """Draws and stores the frames of a run between the times `shown_s` [s]."""

    def __init__(self, shown_s: tuple[float, float]) -> None:
        self.shown_s = shown_s
        self.frames: list[Image] = []

    def take(self, frame: AnyFrame, line: Line, step: Step, guidance: Guidance | None = None) -> None:
        """Draw a frame with a close-up of the target, and store it."""
        if not isinstance(frame, Frame) or not self.shown_s[0] <= step.estimates[FILTER].time_s <= self.shown_s[1]:
            return
        network, (width, height), (left, top) = line.scene.network, NEAR_PX, NEAR_CORNER_PX
        rest_m = network.positions[network.index(line.scene.target.node)]
        image, camera = enlarged(frame.image, line.camera, rest_m, WHOLE, WHOLE_AT_PX, SIZE_PX)
        picture = drawn(image, overlay_of(line, step, camera, guidance, PLAN))
        image, camera = enlarged(frame.image, line.camera, rest_m, NEAR, (0.5 * width, 0.5 * height), NEAR_PX)
        near = sketched(image, replace(overlay_of(line, step, camera, guidance, PLAN), marks=()))
        end_px = 10.0 + 10.0 / camera.mm_per_px(rest_m)[0]
        draw_line(near, np.array([[10.0, height - 10.0], [end_px, height - 10.0]]), LIGHT, 2)
        draw_text(near, "10 mm", (8.0, height - 36.0), LIGHT, 1.0)
        cv2.rectangle(near, (0, 0), (width - 1, height - 1), LIGHT, 1)
        picture[top : top + height, left : left + width] = near
        self.frames.append(picture)


def enlarged(
    image: Image, camera: PlaneCamera, at_m: np.ndarray, by: float, at_px: tuple[float, float], size_px: tuple[int, int]
) -> tuple[Image, PlaneCamera]:
    """The picture enlarged by the factor `by`, and its new camera. The pixel at_px then shows the point at_m [m]."""
    u, v = camera.project(at_m[None])[0]
    enlarge = np.array([[by, 0.0, at_px[0] - by * u], [0.0, by, at_px[1] - by * v], [0.0, 0.0, 1.0]])
    larger = cv2.warpAffine(image, enlarge[:2], size_px, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    closer = replace(camera, size_px=size_px, plane_to_px=enlarge @ camera.plane_to_px)
    return np.asarray(larger, dtype=np.uint8), closer


def write_moving_picture(path: Path, scenario: Scenario = SCENARIO, shown_s: tuple[float, float] = SHOWN_S) -> None:
    """Film the scenario with advice for a needle, and write the frames between the times `shown_s` [s] as WebP."""
    watched, film = Watched(shown_s), cv2.Animation()
    with tempfile.TemporaryDirectory() as folder:
        simulate(scenario, Path(folder) / "recording")
        advise(read_recording(Path(folder) / "recording"), PLAN, watch=watched)
    film.frames = watched.frames
    film.durations = [round(1e3 * SLOWER * scenario.frame_interval_s)] * len(watched.frames)
    write_whole(path, cv2.imencodeanimation(".webp", film, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1].tobytes())


if __name__ == "__main__":
    write_moving_picture(PICTURE)
