"""True motion of a poked and breathing body, by SciPy's DOP853."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dynamics import MassSpringNetwork
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.scenario import Scenario, read_scenario
from experiments.formats.scenario_forces import Breathing, Pokes, Posture
from experiments.formats.scene.scene import Scene
from experiments.simulation.forces import breathing_force, poke_force
from experiments.studies.faults.world import Motion, moved

Becomes = Callable[[MassSpringNetwork], MassSpringNetwork]
Changes = Callable[[Scene, np.random.Generator], MassSpringNetwork]
"""Function that returns the true network of a scene."""

SECOND = {2: [1.0, -0.2], 3: [1.0, -0.2, 0.4]}
"""Direction of a second breath, by dimension; the first breath's direction is upward."""


TURNS_S = 4.0
"""Time at which gravity begins to turn [s]."""


@dataclass(frozen=True, slots=True)
class Pushes:
    """Forces on the body.

    pokes_m_s2, breath_m_s2: accelerations of the marked nodes by pokes and by a breath; 0 means none
    everywhere: whether the breath accelerates all free nodes; hidden: whether the target is also poked
    turned_deg: angle by which gravity turns in 2 s
    second: whether there is a second breath with another period and direction
    """

    pokes_m_s2: float = 5.0
    breath_m_s2: float = 2.0
    everywhere: bool = False
    turned_deg: float = 0.0
    hidden: bool = False
    second: bool = False


PUSHES = Pushes()


@dataclass(frozen=True, slots=True)
class Truth:
    """The true body and the forces on it.

    network: function that returns the body's network; becomes: function that changes the network at onset_s [s]
    """

    network: Changes = lambda scene, _rng: scene.network
    becomes: Becomes = lambda network: network
    onset_s: float = 0.0
    pushes: Pushes = PUSHES


AS_STATED = Truth()


@lru_cache(maxsize=32)
def motion_of(scene: Scene, truth: Truth, seed: int, duration_s: float) -> Motion:
    """The true motion of a scene's body; cached, because most worlds have the same motion.

    Raises RuntimeError if the body has no rest shape, which does not happen for an accepted scene.
    """
    network = truth.network(scene, np.random.default_rng([seed, 11]))
    scenario = _scenario(scene, truth.pushes, seed, duration_s)
    more = None
    if truth.pushes.second:
        breath = _breath(scene, truth.pushes, SECOND[network.dim])
        more = breathing_force(network, breath, np.random.default_rng([seed, 12]))
    if truth.pushes.hidden:
        pokes = _pokes(truth.pushes, [scene.target.node])
        more = poke_force(network, pokes, duration_s, np.random.default_rng([seed, 12]))
    try:
        return moved(scenario, network, truth.becomes, truth.onset_s, more)
    except InputError as error:
        raise RuntimeError(f"truth: {error}") from error


def _scenario(scene: Scene, pushes: Pushes, seed: int, duration_s: float) -> Scenario:
    changes = {
        "seed": seed,
        "duration_s": duration_s,
        "tremor": None,
        "pokes": _pokes(pushes, list(scene.measured_nodes)) if pushes.pokes_m_s2 else None,
        "breathing": _breath(scene, pushes) if pushes.breath_m_s2 else None,
        "posture": _posture(scene.network.gravity, pushes.turned_deg) if pushes.turned_deg else None,
    }
    return read_scenario("poked").model_copy(update=changes)


def _pokes(pushes: Pushes, nodes: list[str]) -> Pokes:
    return Pokes(nodes=nodes, acceleration_m_s2=pushes.pokes_m_s2, shortest_s=0.1, longest_s=0.4, pause_s=1.5)


def _posture(gravity: Floats, turned_deg: float) -> Posture:
    """Gravity turns by this angle, from the axis along which it acts towards the next axis."""
    angle = np.radians(turned_deg)
    to = np.cos(angle) * gravity + np.sin(angle) * np.roll(gravity, 1)
    return Posture(from_m_s2=gravity.tolist(), to_m_s2=to.tolist(), start_s=TURNS_S)


def _breath(scene: Scene, pushes: Pushes, direction: list[float] | None = None) -> Breathing:
    free = [scene.network.names[i] for i in scene.network.free]
    return Breathing(
        nodes=free if pushes.everywhere else list(scene.measured_nodes),
        acceleration_m_s2=pushes.breath_m_s2,
        shortest_s=3.0,
        longest_s=6.0,
        direction=direction,
    )
