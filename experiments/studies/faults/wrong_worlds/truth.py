"""How a body truly moves: poked and breathing, by SciPy's DOP853."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dynamics import MassSpringNetwork
from experiments.arrays import Floats
from experiments.formats.scenario import Breathing, Pokes, Scenario, read_scenario
from experiments.formats.scene.scene import Scene
from experiments.simulation.simulate import breathing_force
from experiments.studies.faults.world import Motion, moved

Becomes = Callable[[MassSpringNetwork], MassSpringNetwork]
Changes = Callable[[Scene, np.random.Generator], MassSpringNetwork]
"""The true network of a scene, which the scene does not state."""

SECOND = {2: [1.0, -0.2], 3: [1.0, -0.2, 0.4]}
"""Direction of a second breath, by dimension; the first goes upward."""


@dataclass(frozen=True, slots=True)
class Pushes:
    """What pushes the body: pokes and a breath [m/s²] of the marked nodes.

    hidden: the target is poked, too; second: a second breath, of another period and direction
    """

    pokes_m_s2: float = 5.0
    breath_m_s2: float = 2.0
    hidden: bool = False
    second: bool = False


PUSHES = Pushes()


@dataclass(frozen=True, slots=True)
class Truth:
    """How the true body differs from the scene's: from the first exposure on, and from the onset [s] on; its pushes."""

    network: Changes = lambda scene, _rng: scene.network
    becomes: Becomes = lambda network: network
    onset_s: float = 0.0
    pushes: Pushes = PUSHES


AS_STATED = Truth()


def motion_of(scene: Scene, truth: Truth, seed: int, duration_s: float) -> Motion:
    """The motion of a scene's body; kept of one that is as stated, for most worlds are of the same."""
    if truth == AS_STATED:
        return _as_stated(scene, seed, duration_s)
    return _moved(scene, truth, seed, duration_s)


@lru_cache(maxsize=8)
def _as_stated(scene: Scene, seed: int, duration_s: float) -> Motion:
    return _moved(scene, AS_STATED, seed, duration_s)


def _moved(scene: Scene, truth: Truth, seed: int, duration_s: float) -> Motion:
    network = truth.network(scene, np.random.default_rng([seed, 11]))
    scenario = _scenario(scene, truth.pushes, seed, duration_s)
    second = None
    if truth.pushes.second:
        breath = _breath(scene, truth.pushes.breath_m_s2, SECOND[network.dim])
        second = breathing_force(network, breath, np.random.default_rng([seed, 12]))
    return moved(scenario, network, truth.becomes, truth.onset_s, second)


def _scenario(scene: Scene, pushes: Pushes, seed: int, duration_s: float) -> Scenario:
    usual = read_scenario("poked")
    assert usual.pokes is not None
    marked = list(scene.measured_nodes)
    poked = [*marked, scene.target.node] if pushes.hidden else marked
    pokes: Pokes = usual.pokes.model_copy(update={"nodes": poked, "acceleration_m_s2": pushes.pokes_m_s2})
    changes = {
        "seed": seed,
        "duration_s": duration_s,
        "tremor": None,
        "pokes": pokes,
        "breathing": _breath(scene, pushes.breath_m_s2),
    }
    return usual.model_copy(update=changes)


def _breath(scene: Scene, strength_m_s2: float, direction: list[float] | None = None) -> Breathing:
    return Breathing(
        nodes=list(scene.measured_nodes),
        acceleration_m_s2=strength_m_s2,
        shortest_s=3.0,
        longest_s=6.0,
        direction=direction,
    )


def straight(motion: Motion, times_s: Floats) -> Floats:
    """Where all nodes are at these times [s], (n,), [m], (n, n_nodes, dim)."""
    return np.array([motion.at(float(t)) for t in times_s])
