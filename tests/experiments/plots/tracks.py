"""Constructed tracks, without a filter: the hidden mass on a circle, and estimates as a test wants them."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from dynamics import HIDDEN
from estimators import MarkMeasurement, Status, TargetEstimate
from experiments.formats.recording import Recording
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import FILTER, OPEN_LOOP, Step
from experiments.pipeline.track import Track
from experiments.simulation.simulate import scene_of
from tests.networks import build_network


def phantom() -> Scene:
    """The four-mass phantom, marked by another tracker."""
    return replace(scene_of(read_scenario("quiet")), cameras=())


def block() -> Scene:
    """48 nodes in space, 4 x 4 x 3, 20 mm apart, each joined to all within 35 mm: some 300 springs."""
    grid = 0.02 * np.array([(i, j, k) for i in range(4) for j in range(4) for k in range(3)], dtype=float)
    gaps = np.linalg.norm(grid[:, None] - grid, axis=2)
    springs = np.argwhere((gaps < 0.035) & np.triu(np.ones_like(gaps, dtype=bool), 1))
    names = ["M2" if i == 22 else f"N{i}" for i in range(len(grid))]
    held, constants = np.flatnonzero(grid[:, 2] == 0.0), {"masses": 0.01, "stiffness": 50.0, "damping": 0.1}
    network = build_network(grid, springs, held, names, **constants)
    scene = phantom()
    marks = tuple(replace(scene.marks[0], node=f"N{i}") for i in (2, 5, 47))
    return replace(scene, network=network, marks=marks, target=replace(scene.target, node=HIDDEN))


def made_track(scene: Scene, errors_m: np.ndarray, sigmas_m: np.ndarray, *, with_truth: bool = True) -> Track:
    """Estimates off by errors_m (n, dim) from a circle of 5 mm about the target's rest, of sigma (n,) an axis [m].

    The open loop is 3 mm off an axis; marks are seen within 2 mm, at rest, alike after 50 frames.
    """
    n, dim = errors_m.shape
    rng, times_s = np.random.default_rng(3), np.arange(n) / 30.0
    rest = scene.network.positions[scene.network.index(HIDDEN)]
    truth = np.repeat(rest[None], n, axis=0)
    truth[:, :2] += 5e-3 * np.stack([np.cos(times_s), np.sin(times_s)], axis=1)
    papers = truth + rng.normal(0.0, 3e-3, (n, dim))
    places = {node: scene.network.positions[scene.network.index(node)] for node in scene.measured_nodes}
    marked = [
        tuple(
            MarkMeasurement(node, place + rng.uniform(-2e-3, 2e-3, dim), 1e-6 * np.eye(dim))
            for node, place in places.items()
        )
        for _ in range(50)
    ]
    steps = []
    for k in range(n):
        marks = marked[k % len(marked)]
        cov = np.diag(np.full(dim, sigmas_m[k] ** 2))
        ours = TargetEstimate(times_s[k], truth[k] + errors_m[k], cov, Status.TRACKING, len(marks), nis=6.0)
        theirs = TargetEstimate(times_s[k], papers[k], None, Status.TRACKING, len(marks))
        steps.append(Step({FILTER: ours, OPEN_LOOP: theirs}, marks, 0.0, {FILTER: 1e-3, OPEN_LOOP: 1e-3}))
    recording = Recording(Path(), scene, times_s, None, (), None, ())
    known = truth if with_truth else np.full((n, dim), np.nan)
    return Track(recording, tuple(steps), known, np.zeros((n, dim, dim)))


def small_errors(n: int, dim: int) -> np.ndarray:
    """Errors of 1 mm an axis [m], (n, dim)."""
    return np.random.default_rng(4).normal(0.0, 1e-3, (n, dim))
