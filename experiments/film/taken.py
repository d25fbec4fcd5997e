"""Counts of pixels in the hue ranges of a scene's marks, for each frame of a film, with pictures of extreme frames."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from experiments.errors import InputError
from experiments.film.film import FILM
from experiments.film.overlay import hue_colour, scale_of
from experiments.film.strokes import darken, draw_text, text_height
from experiments.film.worst import captioned, side_by_side
from experiments.formats.outputs import write_whole
from experiments.formats.scene.scene import Scene
from experiments.formats.tables import write_table
from experiments.pipeline.frame_sources import check_size, open_source
from vision import NOMINAL_FPS, EveryFrame, MarkHue, VideoWriter
from vision.arrays import Image, Picture
from vision.detection.palette import classes_of, palette_of
from vision.detection.settings import DETECTION

TABLE, STILL = "hue.csv", "hue.png"


@dataclass(frozen=True, slots=True)
class Kind:
    """The marks of one hue; the total area of their images [px], and the least area that the detector accepts [px]."""

    nodes: tuple[str, ...]
    hue: MarkHue
    area_px: float
    least_px: float

    @property
    def keys(self) -> str:
        """The hue range in words."""
        return f"hue {self.hue.hue_deg:g} ± {self.hue.half_width_deg:g}"


@dataclass(slots=True, eq=False)
class Taken:
    """Counter of pixels in the colour range of each kind of marks, which have one hue.

    times_s: times of the frames [s]; pixels: for each frame, the number of pixels of each kind
    stills: for each kind, the frame with the fewest pixels of the kind, and the frame with the most
    """

    kinds: tuple[Kind, ...]
    size_px: tuple[int, int]
    times_s: list[float] = field(default_factory=list)
    pixels: list[list[int]] = field(default_factory=list)
    stills: dict[tuple[int, str], tuple[int, float, Image]] = field(default_factory=dict)

    def take(self, time_s: float, pixels: Sequence[int], picture: Image) -> None:
        """Store the pixel counts of a frame; store its picture if the count of a kind is a new extreme."""
        self.times_s.append(time_s)
        self.pixels.append(list(pixels))
        for k, n in enumerate(pixels):
            for what, better in (("least", -1), ("most", 1)):
                known = self.stills.get((k, what))
                if known is None or better * n > better * known[0]:
                    self.stills[k, what] = n, time_s, picture

    def figures(self) -> list[dict[str, Any]]:
        """Statistics of the number of pixels over all frames; an entry for each kind of marks."""
        whole = self.size_px[0] * self.size_px[1]
        counts = np.array(self.pixels, dtype=float)
        most = DETECTION.components.max_picture_share
        return [
            {
                "marks": list(kind.nodes),
                "keys": kind.keys,
                "share_median": float(np.median(counts[:, k]) / whole),
                "share_least": float(counts[:, k].min() / whole),
                "share_most": float(counts[:, k].max() / whole),
                "by_marks": float(np.median(counts[:, k]) / kind.area_px),
                "frames_too_few": float((counts[:, k] < kind.least_px).mean()),
                "frames_flooded": float((counts[:, k] > most * whole).mean()),
            }
            for k, kind in enumerate(self.kinds)
        ]


def kinds_of(scene: Scene) -> tuple[Kind, ...]:
    """The scene's marks grouped by hue, with their area in the picture at rest."""
    camera, network = scene.cameras[0], scene.network
    shapes = {mark.node: mark.shape_px(camera, network.positions[network.index(mark.node)]) for mark in scene.marks}
    areas = {node: np.pi * abs(float(np.linalg.det(shape))) for node, shape in shapes.items()}
    hues = dict.fromkeys(mark.hue for mark in scene.marks)
    least = DETECTION.outline.min_share
    kinds = []
    for hue in hues:
        nodes = tuple(mark.node for mark in scene.marks if mark.hue == hue)
        own = [areas[node] for node in nodes]
        kinds.append(Kind(nodes, hue, sum(own), least * min(own)))
    return tuple(kinds)


def painted(image: Image, classes: Picture, taken: Taken, pixels: Sequence[int]) -> Image:
    """A grey copy of a frame. Pixels in the colour range of a kind of marks have its hue; text states their share.

    classes: the kind of each pixel, counted from 1
    """
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    picture = np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    darken(picture, 0.0, len(picture))
    for k, kind in enumerate(taken.kinds):
        picture[classes == k + 1] = hue_colour(kind.hue.hue_deg)
    scale = scale_of(picture)
    line = text_height(scale)
    darken(picture, 0.0, len(pixels) * line + 8.0)
    for k, (kind, n) in enumerate(zip(taken.kinds, pixels, strict=True)):
        text = f"{kind.keys}: {100.0 * n / classes.size:.2f} %, {n / kind.area_px:.1f} times {', '.join(kind.nodes)}"
        draw_text(picture, text, (5.0 * scale, 4.0 + k * line), hue_colour(kind.hue.hue_deg), scale)
    return picture


def taken_over(
    source: str, scene_path: Path | None, folder: Path | None, *, film: bool = False, fps: float | None = None
) -> Taken:
    """Count the pixels in the colour range of each mark, in a film, folder of pictures or recording. Raises InputError.

    folder: existing folder for hue.csv, hue.png and, if film is True, film.avi; None to write nothing
    """
    scene, frames = open_source(source, scene_path, live=False, fps=fps, usual_fps=NOMINAL_FPS)
    with frames:
        if scene is None or not scene.cameras:
            raise InputError.at("hue", "--at U,V, or --scene scene.toml with a camera", "neither")
        if not isinstance(frames, EveryFrame):
            raise InputError.at(source, "a film, a folder of pictures or a recording, or --at", "a camera")
        taken = _taken(frames, scene, folder if film else None)
    if folder is not None:
        _write(taken, folder)
    return taken


def _taken(frames: EveryFrame, scene: Scene, folder: Path | None) -> Taken:
    taken = Taken(kinds_of(scene), scene.cameras[0].size_px)
    palette = palette_of(tuple(kind.hue for kind in taken.kinds))
    others = iter(frames)
    first = list(islice(others, 2))
    if not first:
        raise InputError("hue: expected frames, found none")
    fps = NOMINAL_FPS if len(first) < 2 else 1.0 / max(first[1].exposure_s - first[0].exposure_s, 1e-3)
    with nullcontext() if folder is None else VideoWriter(folder / FILM, taken.size_px, fps) as writer:
        for frame in chain(first, others):
            check_size(frame, scene)
            classes = classes_of(frame.image, palette, 1)
            counted = np.bincount(classes.ravel(), minlength=len(taken.kinds) + 1)[1:].tolist()
            picture = painted(frame.image, classes, taken, counted)
            taken.take(frame.exposure_s, counted, picture)
            if writer is not None:
                writer.write(picture)
    return taken


def _write(taken: Taken, folder: Path) -> None:
    whole = taken.size_px[0] * taken.size_px[1]
    write_table(
        folder / TABLE,
        ["frame", "time_s", "marks", "hue_deg", "pixels", "share"],
        (
            [str(i), f"{time_s:.9f}", " ".join(kind.nodes), f"{kind.hue.hue_deg:g}", str(n), f"{n / whole:.9g}"]
            for i, (time_s, pixels) in enumerate(zip(taken.times_s, taken.pixels, strict=True))
            for kind, n in zip(taken.kinds, pixels, strict=True)
        ),
    )
    tiles = [
        captioned(picture, f"{what} of {taken.kinds[k].keys}, at {time_s:.2f} s")
        for (k, what), (_, time_s, picture) in taken.stills.items()
    ]
    write_whole(folder / STILL, cv2.imencode(".png", side_by_side(tiles))[1].tobytes())


def verdicts(taken: Taken) -> list[str]:
    """A sentence for each kind of marks whose colour range selects too many or too few pixels."""
    verdicts = []
    for figures, kind in zip(taken.figures(), taken.kinds, strict=True):
        names = f"mark{'s' * (len(kind.nodes) > 1)} {', '.join(kind.nodes)}: {kind.keys}"
        flooded, few, times = (float(figures[key]) for key in ("frames_flooded", "frames_too_few", "by_marks"))
        if flooded > 0.0:
            verdicts.append(
                f"{names} selects more of the picture than marks can cover in {100.0 * flooded:.0f} % of frames: "
                "narrow half_width_deg or raise min_saturation"
            )
        elif few > 0.0:
            verdicts.append(
                f"{names} selects less than one mark must show, {kind.least_px:.0f} px, in {100.0 * few:.0f} % of "
                "frames: learn its keys there, softaim hue FILM --at U,V --frame N"
            )
        elif times > DETECTION.centers.max_area:
            verdicts.append(
                f"{names} selects {times:.1f} times the area of its marks: other things have this hue, or "
                "diameter_mm or the scale of the camera is wrong"
            )
    return verdicts
