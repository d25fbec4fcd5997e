"""The open loop of [paper]: marked masses follow their marks, hidden masses follow their equations of motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynamics import MassSpringNetwork, Stepper, pack, rest_shape, unpack
from estimators.process.target import TargetPoint, target_map
from estimators.tissue.estimate import MarkMeasurement, Status, TargetEstimate
from estimators.tissue.settings import FilterSettings

LONGEST_S = FilterSettings().forget_s
"""Longest simulated time between two frames [s]. After this time without a mark, `TissueFilter` resets its state."""


class OpenLoop:
    """Open-loop simulation of the target, driven by the marks. Source: [paper], section III and Fig. 5.

    Between two frames, a marked mass moves at constant velocity from its old position to its new position; [paper] does
    not define this motion. If a mark is not visible, its mass is integrated like the hidden masses, as in [paper]. The
    integrator is the classical Runge-Kutta method.

    State: positions [m] and velocities [m/s] of all nodes, (n_nodes, dim) each, at time_s [s].
    """

    def __init__(self, network: MassSpringNetwork, target: str | TargetPoint) -> None:
        self.network = network
        self.positions = rest_shape(network)
        self.velocities = np.zeros_like(self.positions)
        self.time_s: float | None = None
        self.target = target_map(network, target)
        self._stepper = Stepper(network)
        self._free = set(network.free.tolist())

    def update(self, time_s: float, marks: Sequence[MarkMeasurement]) -> TargetEstimate:
        """Simulate until an exposure time [s]. At this time, the marked masses are at their measured positions."""
        seen = {self.network.index(mark.node): np.asarray(mark.position, dtype=float) for mark in marks}
        if not np.isfinite(time_s) or (self.time_s is not None and time_s < self.time_s):
            raise ValueError(f"time_s: expected {self.time_s} or later, found {time_s}")
        if not set(seen) <= self._free:
            raise ValueError(f"marks: expected names of free nodes, found {[mark.node for mark in marks]}")
        dt = 0.0 if self.time_s is None else min(time_s - self.time_s, LONGEST_S)
        positions, velocities, free = self.positions.copy(), self.velocities.copy(), self.network.free
        if dt > 0.0:
            for node, place in seen.items():
                velocities[node] = (place - positions[node]) / dt
            state = pack(positions[free], velocities[free])
            moved = self._stepper.advance(state[None], dt, driven=sorted(seen))[0]
            positions[free], velocities[free] = unpack(moved, self.network.dim)
        for node, place in seen.items():
            positions[node] = place  # removes the last rounding error
        self.positions, self.velocities, self.time_s = positions, velocities, time_s
        status = Status.TRACKING if marks else Status.COASTING
        mean = self.target.position(self.positions[self.network.free].ravel())
        return TargetEstimate(time_s, mean, None, status, len(marks))
