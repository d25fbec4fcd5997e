"""The tissue simulated while nodes are led along their marks: the paper's open loop, step by step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dynamics import ImplicitStepper, Stepper, pack, unpack
from estimators.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Simulated:
    """All nodes of a simulated tissue: positions [m] and velocities [m/s], each (n_nodes, dim)."""

    positions: Floats
    velocities: Floats


def led_along(stepper: Stepper | ImplicitStepper, now: Simulated, dt: float, places: Mapping[int, Floats]) -> Simulated:
    """The tissue dt [s] later, these free nodes led to places [m], (dim,), straight and at constant speed.

    The others follow by their equations; at a dt of 0 nodes are set to their places. Source: [paper], section III and
    Fig. 5, which leaves open how a node moves between two frames.
    """
    positions, velocities = now.positions.copy(), now.velocities.copy()
    if dt > 0.0:
        for node, place in places.items():
            velocities[node] = (place - positions[node]) / dt
        free = stepper.network.free
        state = pack(positions[free], velocities[free])
        moved = stepper.advance(state[None], dt, driven=sorted(places))[0]
        positions[free], velocities[free] = unpack(moved, stepper.network.dim)
    for node, place in places.items():
        positions[node] = place  # without the last rounding
    return Simulated(positions, velocities)
