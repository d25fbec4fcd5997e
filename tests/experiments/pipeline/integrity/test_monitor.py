"""When an estimate may guide: bodies that rest otherwise than their scene says, frame by frame."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import rest_shape
from estimators import MarkMeasurement, Status, TargetEstimate
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import Scene
from experiments.pipeline.integrity.monitor import UNTESTED, IntegrityMonitor
from experiments.pipeline.line import Line
from experiments.simulation.simulate import scene_of

FRAME_S = 1.0 / 30.0


@pytest.fixture(scope="module")
def scene() -> Scene:
    return scene_of(read_scenario("webcam"))


def faults(scene: Scene, positions: np.ndarray, *, frames: int = 60, seen_from: int = 0) -> list:
    """What a monitor says of each frame in which marks stand here [m], (n_nodes, dim), the filter TRACKING."""
    monitor, found = IntegrityMonitor(scene, Line(scene, baseline=False).filter), []
    for frame in range(frames):
        shown = frame >= seen_from
        marks = [
            MarkMeasurement(node, positions[scene.network.index(node)], 1e-6 * np.eye(2))
            for node in (scene.measured_nodes if shown else ())
        ]
        estimate = TargetEstimate(frame * FRAME_S, np.zeros(2), 1e-6 * np.eye(2), Status.TRACKING, len(marks))
        found.append(monitor.take(estimate, marks))
    return found


def cut(scene: Scene) -> np.ndarray:
    """Where the body rests without the spring of its target that bears most [m], (n_nodes, dim)."""
    network = scene.network
    i, j = network.springs.T
    lengths = np.linalg.norm(network.positions[j] - network.positions[i], axis=1)
    tension = np.abs(network.stiffness * (lengths - network.rest_lengths))
    own = (network.springs == network.index(scene.target.node)).any(axis=1)
    stiffness = np.where(np.arange(len(own)) == np.argmax(np.where(own, tension, -1.0)), 1e-3, 1.0) * network.stiffness
    return rest_shape(replace(network, stiffness=stiffness))


def test_nothing_guides_before_the_forces_were_tested(scene):
    """Two seconds from the first marks on."""
    found = faults(scene, scene.network.positions, seen_from=10, frames=90)
    assert found == [UNTESTED] * 70 + [None] * 20


def test_a_spring_that_is_cut_from_the_start_never_guides(scene):
    found = faults(scene, cut(scene))
    assert None not in found
    assert "a force on" in found[-1]


def test_what_was_tested_is_tested_again_after_a_reset(scene):
    monitor = IntegrityMonitor(scene, Line(scene, baseline=False).filter)
    at, cov = dict(zip(scene.network.names, scene.network.positions, strict=True)), 1e-6 * np.eye(2)
    marks = [MarkMeasurement(node, at[node], cov) for node in scene.measured_nodes]
    found = []
    for frame in range(140):
        if frame == 70:
            monitor.restart()
        estimate = TargetEstimate(frame * FRAME_S, np.zeros(2), cov, Status.TRACKING, len(marks))
        found.append(monitor.take(estimate, marks))
    assert (found[69], found[70], found[139]) == (None, UNTESTED, None)
