"""Forces of a scenario on the free nodes over time, and the initial state of the tissue."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import geometric_slerp

from dynamics import MassSpringNetwork, NetworkError, SampledForces, rest_shape
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.scenario import Scenario
from experiments.formats.scenario_forces import UPWARD, Breathing, Pokes, Posture, Press, Tremor


@dataclass(frozen=True, slots=True, eq=False)
class Force:
    """A force on the free nodes over time.

    at: function of the time [s]; it returns the force [N], (n_free, dim)
    bends_s: times at which the slope of the force changes [s], (n,)
    """

    at: Callable[[float], Floats]
    bends_s: Floats

    def __call__(self, t: float) -> Floats:
        """The force at this time [s]."""
        return self.at(t)


def tremor_force(network: MassSpringNetwork, tremor: Tremor, duration_s: float, rng: np.random.Generator) -> Force:
    """A force on each free node: random values at equally spaced times, with linear interpolation in between."""
    n_knots = int(np.ceil(duration_s / tremor.interval_s)) + 2
    sd = tremor.acceleration_m_s2_sqrt_hz / np.sqrt(tremor.interval_s)
    knots = rng.normal(0.0, sd, (n_knots, len(network.free), network.dim))
    knots *= network.masses[network.free][:, None]
    return Force(SampledForces(knots, tremor.interval_s).at, np.arange(0.0, n_knots) * tremor.interval_s)


def poke_force(network: MassSpringNetwork, pokes: Pokes, duration_s: float, rng: np.random.Generator) -> Force:
    """Successive pokes in random directions, with random pauses, see `Pokes`."""
    rows = _rows(network, pokes.nodes)
    starts, ends, peaks = [], [], []
    t = rng.exponential(pokes.pause_s)
    while t < duration_s:
        lasting = rng.uniform(pokes.shortest_s, pokes.longest_s)
        pushed = rows if pokes.together else [int(rng.choice(rows))]
        direction = rng.normal(size=network.dim)
        direction /= np.linalg.norm(direction)
        strength = rng.uniform(pokes.weakest, 1.0) * pokes.acceleration_m_s2
        peak = np.zeros((len(network.free), network.dim))
        peak[pushed] = strength * network.masses[network.free[pushed]][:, None] * direction
        starts.append(t)
        ends.append(t + lasting)
        peaks.append(peak)
        t += lasting + rng.exponential(pokes.pause_s)
    begun, nothing = np.array(starts), np.zeros((len(network.free), network.dim))

    def force(t: float) -> Floats:
        k = int(np.searchsorted(begun, t, side="right")) - 1
        if k >= 0 and t < ends[k]:
            return peaks[k] * np.sin(np.pi * (t - starts[k]) / (ends[k] - starts[k]))
        return nothing

    return Force(force, np.array([*starts, *ends]))


def breathing_force(network: MassSpringNetwork, breathing: Breathing, rng: np.random.Generator) -> Force:
    """A periodic force with a second harmonic; its period and phases are random.

    If `breathing` names no nodes, the force acts on the whole body, see `by_acceleration`.
    """
    direction = np.array(breathing.direction or UPWARD[: network.dim])
    direction *= breathing.acceleration_m_s2 / np.linalg.norm(direction)
    if breathing.nodes is None:
        peak = by_acceleration(network, direction)
    else:
        rows, peak = _rows(network, breathing.nodes), np.zeros((len(network.free), network.dim))
        peak[rows] = network.masses[network.free[rows]][:, None] * direction
    rate = 2.0 * np.pi / rng.uniform(breathing.shortest_s, breathing.longest_s)
    phase, second = rng.uniform(0.0, 2.0 * np.pi, 2)

    def force(t: float) -> Floats:
        return (np.cos(rate * t + phase) + 0.5 * np.cos(2.0 * rate * t + second)) * peak

    return Force(force, np.empty(0))


def posture_force(network: MassSpringNetwork, posture: Posture) -> Force:
    """The rotated gravity force minus the gravity force under which the tissue rests in the drawn shape."""
    before, after = np.array(posture.from_m_s2), np.array(posture.to_m_s2)
    sizes = np.linalg.norm([before, after], axis=1)

    def force(t: float) -> Floats:
        turned = _risen((t - posture.start_s) / posture.lasts_s)
        direction = geometric_slerp(before / sizes[0], after / sizes[1], turned)
        return by_acceleration(network, sizes @ (1.0 - turned, turned) * direction - before)

    return Force(force, posture.start_s + np.array([0.0, posture.lasts_s]))


def press_force(network: MassSpringNetwork, press: Press) -> Force:
    """A force on nodes that rises smoothly, stays constant and falls."""
    rows, peak = _rows(network, press.nodes), np.zeros((len(network.free), network.dim))
    peak[rows] = np.array(press.force_n) / len(rows)
    end_s = press.start_s + press.lasts_s

    def force(t: float) -> Floats:
        return _risen(min(t - press.start_s, end_s - t) / press.rises_s) * peak

    return Force(force, np.array([press.start_s, end_s]))


def _risen(share: float) -> float:
    """A smooth rise from 0 to 1 while `share` rises from 0 to 1: half a period of a cosine."""
    return 0.5 - 0.5 * float(np.cos(np.pi * np.clip(share, 0.0, 1.0)))


def by_acceleration(network: MassSpringNetwork, acceleration: Floats) -> Floats:
    """Forces on the free nodes [N], (n_free, dim), that act like the given acceleration of the whole body [m/s²]."""
    solid = network.continuum
    if solid is None:
        return network.masses[network.free][:, None] * acceleration
    return (solid.stiffness @ (solid.accelerated @ acceleration)).reshape(-1, network.dim)


def _rows(network: MassSpringNetwork, nodes: list[str] | None) -> list[int]:
    """Indices of these nodes. After `completed` has filled in the scenario's defaults, `nodes` is not None."""
    assert nodes is not None
    return [_row(network, node) for node in nodes]


def _row(network: MassSpringNetwork, node: str) -> int:
    try:
        return network.coordinates(node).start // network.dim
    except NetworkError as fault:
        raise InputError(f"scenario: {fault}") from None


def start_and_forces(
    network: MassSpringNetwork, scenario: Scenario, rng: np.random.Generator
) -> tuple[Floats, list[Force]]:
    """Initial positions of the free nodes [m], (n_free, dim), and the forces on them. Raises InputError."""
    rest = network.positions[network.free]
    held = np.zeros_like(rest)
    if scenario.release is not None:
        held[_row(network, scenario.release.node)] = scenario.release.force_n
    try:
        start = rest_shape(network, held)[network.free]
    except NetworkError as fault:
        place = "scenario: release" if scenario.release is not None else scenario.scene or "scenario"
        raise InputError(f"{place}: {fault}") from None
    forces: list[Force] = []
    if scenario.tremor is not None:
        forces.append(tremor_force(network, scenario.tremor, scenario.duration_s, rng))
    if scenario.pokes is not None:
        forces.append(poke_force(network, scenario.pokes, scenario.duration_s, rng))
    if scenario.breathing is not None:
        forces.append(breathing_force(network, scenario.breathing, rng))
    if scenario.posture is not None:
        forces.append(posture_force(network, scenario.posture))
    forces += [press_force(network, press) for press in scenario.press]
    return start, forces
