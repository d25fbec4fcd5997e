"""First marks read by other axes or units than the scene's: which, in words; as they are, nothing is said."""

import numpy as np
import pytest

from dynamics.phantoms.breast import breast_phantom
from experiments.formats.marks.drawing import N_FRAMES, FirstMarks, first_marks_line, misread
from experiments.formats.marks.rows import MarkRow
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.scene import Scene
from experiments.formats.scene.target import Target
from experiments.simulation.simulate import scene_of

FLAT = scene_of(read_scenario("webcam"))
BREAST = breast_phantom()
IN_SPACE = Scene(
    BREAST.network, tuple(Mark(node, 0.0, 0.01) for node in BREAST.outer), Target(BREAST.target, 0.005), ()
)


def places(scene: Scene, sd_m: float) -> np.ndarray:
    """Where the measured marks are drawn [m], (n, dim), and how far they may be seen from there."""
    rng = np.random.default_rng(7)
    network = scene.network
    drawn = network.positions[[network.index(node) for node in scene.measured_nodes]]
    return drawn + rng.normal(0.0, sd_m, drawn.shape)


def said(scene: Scene, seen: np.ndarray) -> str | None:
    return misread(scene, dict(zip(scene.measured_nodes, seen, strict=True)))


OTHERS = {
    "y mirrored: (x, -y) for (x, y)": lambda p: p * [1, -1],
    "x mirrored: (-x, y) for (x, y)": lambda p: p * [-1, 1],
    "a turn by 180 degrees: (-x, -y) for (x, y)": lambda p: -p,
    "a turn by 90 degrees: (y, -x) for (x, y)": lambda p: np.stack([-p[:, 1], p[:, 0]], axis=1),
    "a turn by 90 degrees: (-y, x) for (x, y)": lambda p: np.stack([p[:, 1], -p[:, 0]], axis=1),
    "x and y exchanged: (y, x) for (x, y)": lambda p: p[:, ::-1],
    "x and y exchanged and mirrored: (-y, -x) for (x, y)": lambda p: -p[:, ::-1],
    "lengths in m instead of mm": lambda p: 1e-3 * p,
    "lengths in cm instead of mm": lambda p: 1e-1 * p,
    "lengths in inches instead of mm": lambda p: p / 25.4,
    "lengths in micrometres instead of mm": lambda p: 1e3 * p,
    "lengths in m instead of mm, y mirrored: (x, -y) for (x, y)": lambda p: 1e-3 * p * [1, -1],
    "the numbers as pixels of camera front": lambda p: 1e-3 * FLAT.cameras[0].project(p),
    "y mirrored: (x, -y) for (x, y), times 1, moved by (-300, 500) mm": lambda p: p * [1, -1] + [0.3, 0.5],
    "y mirrored: (x, -y) for (x, y), times 2, moved by (-640, 800) mm": lambda p: 0.5 * p * [1, -1] + [0.32, 0.4],
}


IN_SPACE_OTHERS = {
    "z mirrored: (x, y, -z) for (x, y, z)": lambda p: p * [1, 1, -1],
    "y and z exchanged: (x, z, y) for (x, y, z)": lambda p: p[:, [0, 2, 1]],
    "a turn by 180 degrees about x: (x, -y, -z) for (x, y, z)": lambda p: p * [1, -1, -1],
    "turned axes: (y, z, x) for (x, y, z)": lambda p: p[:, [2, 0, 1]],
    "lengths in m instead of mm": lambda p: 1e-3 * p,
}
READINGS = [
    *((FLAT, 0.0, words, change) for words, change in OTHERS.items()),
    *((FLAT, 4e-3, words, change) for words, change in OTHERS.items() if "moved" not in words),
    *((IN_SPACE, 1e-3, words, change) for words, change in IN_SPACE_OTHERS.items()),
]


@pytest.mark.parametrize(("scene", "sd_m", "words", "change"), READINGS)
def test_another_reading_that_fits_is_named(scene, sd_m, words, change) -> None:
    line = said(scene, change(places(scene, sd_m)))
    assert f" mm with {words}; positions are in mm" in line


NOTHING = {
    "as drawn": lambda p: p,
    "poked by 40 mm": lambda p: p + np.array([[0.04, 0.0]] + [[0.0, 0.0]] * (len(p) - 1)),
    "moved by 30 mm together": lambda p: p + np.array([0.03, 0.0]),
    "beside itself": lambda p: np.random.default_rng(1).normal(0.0, 0.5, p.shape),
    "elsewhere": lambda p: p + np.array([0.9, 0.0]),
}


@pytest.mark.parametrize("name", NOTHING)
def test_where_nothing_simple_fits_better_nothing_is_said(name) -> None:
    assert said(FLAT, NOTHING[name](places(FLAT, 1e-3))) is None


def test_one_mark_says_nothing_of_axes() -> None:
    assert misread(FLAT, {"M3": np.array([0.0, -0.384])}) is None


def test_it_is_said_once_as_soon_as_all_marks_were_seen() -> None:
    first, seen = FirstMarks(FLAT), dict(zip(FLAT.measured_nodes, places(FLAT, 0.0) * [1, -1], strict=True))
    nodes = list(FLAT.measured_nodes)
    assert first.take({}) is None
    assert first.take({nodes[0]: seen[nodes[0]]}) is None
    assert "y mirrored" in (first.take({node: seen[node] for node in nodes[1:]}) or "")
    assert first.take(seen) is None
    assert first.judge() is None


def test_a_mark_that_does_not_come_is_not_waited_for() -> None:
    nodes = list(FLAT.measured_nodes)
    seen = dict(zip(nodes, places(FLAT, 0.0) * [1, -1], strict=True))
    partly = {node: seen[node] for node in nodes[:-1]}
    first = FirstMarks(FLAT)
    lines = [first.take(partly) for _ in range(N_FRAMES)]
    assert lines[:-1] == [None] * (N_FRAMES - 1)
    assert "y mirrored" in (lines[-1] or "")
    rows = [[MarkRow(node, place, 1e-3) for node, place in partly.items()]]
    assert "y mirrored" in (first_marks_line(FLAT, rows) or "")
