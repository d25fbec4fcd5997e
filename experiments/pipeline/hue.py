"""The colour keys of a mark in scene.toml, from the colour at one position in a picture."""

from __future__ import annotations

from experiments.errors import InputError, coordinates, placed
from experiments.pipeline.frame_sources import open_source
from vision import NOMINAL_FPS, HueError, learn_hue


def hue_lines(source: str, at: str, number: int) -> list[str]:
    """Lines with the keys hue_deg, half_width_deg, min_saturation and min_value of a mark in a picture.

    at: pixel on the mark, as "u,v"; number: number of the frame. Raises InputError if the frame has no mark there.
    """
    u, v = coordinates("--at", at, 2, "two numbers, U,V")
    _, frames = open_source(source, None, live=False, usual_fps=NOMINAL_FPS)
    with frames:
        frame = next((frame for frame in frames if frame.index == number), None)
    if frame is None:
        raise InputError(f"{source}: expected a frame {number}, found fewer")
    with placed(f"{source}: frame {number}", HueError, ValueError):
        hue = learn_hue(frame.image, (u, v))
    return [
        f"hue_deg = {hue.hue_deg:.1f}",
        f"half_width_deg = {hue.half_width_deg:.1f}",
        f"min_saturation = {hue.min_saturation:.3f}",
        f"min_value = {hue.min_value:.3f}",
    ]
