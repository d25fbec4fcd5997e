"""Speed of a film with its overlay at 640x480: what `softaim bench` shows as film_640x480.

Recordings of 30 frames/s need 33 ms per frame. Processor times on a busy machine: tracking 4.1 ms, projecting and
drawing 3.4 ms, compression 3.7 ms, in all 11.2 ms. With one of four marks missing in every frame the sum is 32.5 ms, of
which 25 ms are the search for this mark.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from experiments.film.overlay import drawn
from experiments.film.views import overlay_of
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import Line
from vision import VideoWriter
from vision.arrays import Image


def film_640x480(scene: Scene, times_s: Sequence[float], images: Sequence[Image]) -> dict[str, float]:
    """Medians over frames [ms] of the times for tracking with reasons, projecting and drawing, compression, and all."""
    line, camera, seconds = Line(scene, explain=True), scene.cameras[0], []
    with TemporaryDirectory() as folder, VideoWriter(Path(folder) / "film.avi", camera.size_px, 30.0) as writer:
        for time_s, image in zip(times_s, images, strict=True):
            marks = [time.perf_counter()]
            step = line.see(time_s, image)
            marks.append(time.perf_counter())
            picture = drawn(image, overlay_of(line, step, camera))
            marks.append(time.perf_counter())
            writer.write(picture)
            marks.append(time.perf_counter())
            seconds.append([*np.diff(marks), marks[-1] - marks[0]])
    track, draw, encode, total = 1e3 * np.median(seconds[len(seconds) // 10 :], axis=0)
    return {"track_ms": float(track), "draw_ms": float(draw), "encode_ms": float(encode), "total_ms": float(total)}
