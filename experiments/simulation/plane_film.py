"""Simulated film of a flat scene: marks on the plane, drawn over the springs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import vision
from experiments.arrays import Floats
from experiments.formats.scenario import Scenario
from experiments.formats.scene.reference import reference_places
from experiments.formats.scene.scene import Scene
from experiments.simulation.seen_marks import Truth
from experiments.threads import ahead


def film(scenario: Scenario, scene: Scene, truth: Truth, rng: np.random.Generator) -> Iterator[NDArray[np.uint8]]:
    """Pictures of the true motion by the scene's first camera, (height, width, 3) BGR."""
    camera = scene.cameras[0]
    network = scene.network
    lighting = vision.paper_camera() if scenario.light == "paper" else vision.Lighting()
    strays = vision.distractors(scenario.distractors, camera.size_px, rng, hues_of(scene))
    everywhere = network.positions.copy()
    for positions in truth.positions:
        everywhere[network.free] = positions
        yield draw(scene, everywhere, lighting, rng, strays=strays)


def hues_of(scene: Scene) -> list[float]:
    """The different hues of a scene's marks [degrees]."""
    return list(dict.fromkeys(mark.hue_deg for mark in (*scene.marks, *scene.reference.looks)))


def draw(
    scene: Scene, positions: Floats, lighting: vision.Lighting, rng: np.random.Generator, *, strays: list[vision.Disc]
) -> NDArray[np.uint8]:
    """One picture of the scene with nodes at these positions [m], (n_nodes, dim); strays: discs of other objects."""
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


def write_film(
    scenario: Scenario,
    scene: Scene,
    truth: Truth,
    rng: np.random.Generator,
    path: Path,
    advance: Callable[[float], None],
) -> None:
    """Write the film of a flat scene; advance: called with the completed share."""
    rate = max(1.0, 1.0 / scenario.frame_interval_s)  # the file format has no lower rate; frames.csv has the times
    stored = scenario.video
    size_px = scene.cameras[0].size_px
    with (
        vision.VideoWriter(path, size_px, rate, codec=stored.codec, quality=stored.quality) as video,
        ahead(film(scenario, scene, truth, rng)) as images,
    ):
        for k, image in enumerate(images):
            video.write(image)
            advance((k + 1) / len(truth.times_s))
