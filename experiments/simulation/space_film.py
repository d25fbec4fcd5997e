"""Simulated films of a body in space: each camera shows the marks on the skin that face it."""

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
from experiments.simulation.plane_film import hues_of
from experiments.simulation.seen_marks import Truth
from experiments.threads import ahead
from vision import SpaceCamera


def times_of(scenario: Scenario, exposures_s: Floats, n_cameras: int) -> list[Floats]:
    """Exposure times of each camera [s]: each exposes `stagger_s` after the previous camera."""
    return [exposures_s + k * scenario.video.stagger_s for k in range(n_cameras)]


def all_times(times_s: Sequence[Floats]) -> Floats:
    """The exposure times of all cameras, increasing and without repetitions [s]."""
    return np.unique(np.concatenate(times_s).astype(np.float64).round(9))


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

    positions: of the nodes [m], (n_nodes, 3); strays: discs of other objects; covered: nodes whose marks are covered
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


def write_space_films(
    scenario: Scenario,
    scene: Scene,
    times_s: Sequence[Floats],
    truth: Truth,
    folder: Path,
    rng: np.random.Generator,
    advance: Callable[[float], None],
) -> None:
    """Write `video.NAME.avi` and `frames.NAME.csv` of each camera.

    times_s: exposure times of each camera [s]; the truth must be sampled at all of them
    """
    stored, rate = scenario.video, max(1.0, 1.0 / scenario.frame_interval_s)
    lighting = vision.paper_camera() if scenario.light == "paper" else vision.Lighting()
    hues = hues_of(scene)
    done, n_frames = 0, sum(len(own) for own in times_s)
    for i, (camera, own_s) in enumerate(zip(scene.space_cameras, times_s, strict=True)):
        name = film_name(camera.name, i)
        write_frames_csv(folder / f"frames.{name}.csv", own_s)
        strays = vision.distractors(scenario.distractors, camera.size_px, rng, hues)
        path = folder / f"video.{name}.avi"

        def images(
            camera: SpaceCamera = camera, own_s: Floats = own_s, strays: Sequence[vision.Disc] = strays
        ) -> Iterator[NDArray[np.uint8]]:
            everywhere = scene.network.positions.copy()
            for k in np.searchsorted(truth.times_s, own_s - 1e-9).tolist():
                everywhere[scene.network.free] = truth.positions[k]
                yield draw_in_space(scene, camera, everywhere, lighting, rng, strays=strays)

        with (
            vision.VideoWriter(path, camera.size_px, rate, codec=stored.codec, quality=stored.quality) as video,
            ahead(images()) as drawn,
        ):
            for image in drawn:
                video.write(image)
                done += 1
                advance(done / n_frames)
