"""Simulated films. In the plane they show springs and marks, in space the marks on the skin that face the camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import vision
from experiments.arrays import Floats
from experiments.formats.films.several import film_name
from experiments.formats.recording import write_frames_csv
from experiments.formats.scenario import Scenario
from experiments.formats.scene.reference import reference_places
from experiments.formats.scene.scene import Scene
from experiments.formats.scene.space_marks import TOWARD, across, facing, mark_shapes_px, outward
from experiments.simulation.seen_marks import Truth
from experiments.threads import ahead
from vision import PlaneCamera, SpaceCamera


def film(
    scenario: Scenario,
    scene: Scene,
    truth: Truth,
    rng: np.random.Generator,
    camera: PlaneCamera | SpaceCamera | None = None,
    times_s: Floats | None = None,
) -> Iterator[NDArray[np.uint8]]:
    """Pictures of the true motion, (height, width, 3) BGR.

    camera: default for a scene in the plane: its first camera
    times_s: exposure times [s]; by default, all times of `truth`
    """
    camera = scene.cameras[0] if camera is None else camera
    lighting = vision.paper_camera() if scenario.light == "paper" else vision.Lighting()
    strays = vision.distractors(scenario.distractors, camera.size_px, rng, hues_of(scene))
    everywhere = scene.network.positions.copy()
    for k in np.searchsorted(truth.times_s, (truth.times_s if times_s is None else times_s) - 1e-9).tolist():
        everywhere[scene.network.free] = truth.positions[k]
        if isinstance(camera, SpaceCamera):
            yield draw_in_space(scene, camera, everywhere, lighting, rng, strays=strays)
        else:
            yield draw(scene, everywhere, lighting, rng, strays=strays)


def hues_of(scene: Scene) -> list[float]:
    """The different hues of a scene's marks [degrees]."""
    return list(dict.fromkeys(mark.hue_deg for mark in (*scene.marks, *scene.reference.looks)))


def draw(
    scene: Scene, positions: Floats, lighting: vision.Lighting, rng: np.random.Generator, *, strays: list[vision.Disc]
) -> NDArray[np.uint8]:
    """One picture of the scene with the nodes at `positions` [m], (n_nodes, dim). `strays` are discs but not marks."""
    camera, network = scene.cameras[0], scene.network
    places = camera.project(positions)
    lines = [(tuple(places[i]), tuple(places[j])) for i, j in network.springs]
    discs = []
    still = reference_places(scene.reference, network)
    seen = [(mark, positions[network.index(mark.node)]) for mark in scene.marks]
    for mark, place in [*seen, *((mark, still[mark.node]) for mark in scene.reference.looks)]:
        half_px = 0.5e3 * mark.diameter_m / camera.mm_per_px(place)
        across, down = np.diag(mark.shape_px(camera, place)) if mark.ball else half_px
        discs.append(vision.Disc(camera.project(place[None])[0], (across, down), mark.hue_deg))
    return vision.draw_frame(camera.size_px, [*strays, *discs], lighting, rng, lines=lines)


def draw_in_space(
    scene: Scene,
    camera: SpaceCamera,
    positions: Floats,
    lighting: vision.Lighting,
    rng: np.random.Generator,
    *,
    strays: Sequence[vision.Disc] = (),
    covered: Sequence[str] = (),
) -> NDArray[np.uint8]:
    """A camera's picture of the measured marks and reference marks that face it.

    positions: positions of the nodes [m], (n_nodes, 3)
    strays: discs that are not marks; covered: nodes whose marks are covered
    """
    network = scene.network
    marks = [mark for mark in scene.marks if mark.measured and mark.node not in covered]
    nodes = [mark.node for mark in marks]
    looks, still = scene.reference.looks, reference_places(scene.reference, network)
    places = np.vstack([positions[[network.index(node) for node in nodes]], *(still[look.node] for look in looks)])
    normals = np.vstack([outward(scene, nodes), np.tile(TOWARD, (len(looks), 1))])
    marks += looks
    inside, places_px, J = camera.viewed(places)
    shapes_px = mark_shapes_px(marks, camera, places, across(normals), J)
    shown = np.flatnonzero(inside & facing(camera, places, normals, 0.0))
    nearest_last = shown[np.argsort(-np.linalg.norm(places[shown] - camera.centre_m, axis=1))]
    discs = [vision.Disc.of_shape(places_px[i], shapes_px[i], marks[i].hue_deg) for i in nearest_last.tolist()]
    return vision.draw_frame(camera.size_px, [*strays, *discs], lighting, rng)


def write_films(
    scenario: Scenario,
    scene: Scene,
    times_s: Sequence[Floats],
    truth: Truth,
    folder: Path,
    rng: np.random.Generator,
    advance: Callable[[float], None],
) -> None:
    """Write `video.avi` and `frames.csv`; in space, `video.NAME.avi` and `frames.NAME.csv` for each camera.

    times_s: exposure times of each camera [s]; `truth` contains all of them
    advance: called with the completed share
    """
    rate = max(1.0, 1.0 / scenario.frame_interval_s)  # the file format has no lower rate; frames.csv has the times
    stored, done, n_frames = scenario.video, 0, sum(map(len, times_s))
    cameras: Sequence[PlaneCamera | SpaceCamera] = scene.cameras or scene.space_cameras
    for i, (camera, own_s) in enumerate(zip(cameras, times_s, strict=True)):
        of = "" if scene.cameras else f".{film_name(camera.name, i)}"
        write_frames_csv(folder / f"frames{of}.csv", own_s)
        path = folder / f"video{of}.avi"
        with (
            vision.VideoWriter(path, camera.size_px, rate, codec=stored.codec, quality=stored.quality) as video,
            ahead(film(scenario, scene, truth, rng, camera, own_s)) as images,
        ):
            for image in images:
                video.write(image)
                done += 1
                advance(done / n_frames)
