"""The paper's method: the marked masses are put where they are seen, the hidden ones follow by their equations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from dynamics import MassSpringNetwork, node_forces, rest_shape
from estimators.estimate import MarkMeasurement, Status, TargetEstimate

Floats = NDArray[np.float64]


class OpenLoop:
    """The target by open-loop simulation, driven by the marks. Source: [paper], section III and Fig. 5.

    Between two frames a measured mass moves in a straight line at constant speed, which is chosen: the paper does not
    say, and of what can be done without looking ahead this serves the method best. A marked mass that was not seen is
    integrated like the hidden ones, from where it was last, as the paper provides ("additional second-order
    integration ... in case of losing of data"). The integrator is SciPy's adaptive Runge-Kutta of order 4(5).

    State: positions and velocities of all nodes [m, m/s], (n_nodes, dim), at time_s.
    """

    def __init__(self, network: MassSpringNetwork, target: str, *, rtol: float = 1e-4, atol: float = 1e-6) -> None:
        self.network = network
        self.positions = rest_shape(network)
        self.velocities = np.zeros_like(self.positions)
        self.time_s: float | None = None
        self._target = network.index(target)
        self._tolerances = {"rtol": rtol, "atol": atol}
        self._free = set(network.free.tolist())

    def update(self, time_s: float, marks: Sequence[MarkMeasurement]) -> TargetEstimate:
        """Go on to this exposure time [s], the marked masses moving to where they were seen."""
        seen = {self.network.index(mark.node): np.asarray(mark.position, dtype=float) for mark in marks}
        if not np.isfinite(time_s) or (self.time_s is not None and time_s < self.time_s):
            raise ValueError(f"time_s: expected {self.time_s} or later, found {time_s}")
        if not set(seen) <= self._free:
            raise ValueError(f"marks: expected them on free nodes, found {[mark.node for mark in marks]}")
        if self.time_s is None or time_s == self.time_s:
            for node, position in seen.items():
                self.positions[node] = position
        else:
            self._follow(time_s - self.time_s, seen)
        self.time_s = time_s
        status = Status.TRACKING if marks else Status.COASTING
        return TargetEstimate(time_s, self.positions[self._target].copy(), None, status, len(marks))

    def _follow(self, dt: float, seen: dict[int, Floats]) -> None:
        driven = np.array(sorted(seen), dtype=int)
        moving = np.array(sorted(self._free - set(seen)), dtype=int)
        start = self.positions.copy()
        velocities = self.velocities.copy()
        for node in driven:
            velocities[node] = (seen[node] - start[node]) / dt
        shape = (2, len(moving), self.network.dim)
        masses = self.network.masses[moving, None]

        def motion(t: float, state: Floats) -> Floats:
            x, v = start.copy(), velocities.copy()
            x[driven] += t * velocities[driven]
            x[moving], v[moving] = state.reshape(shape)
            acceleration = node_forces(self.network, x, v)[moving] / masses
            return np.concatenate([v[moving].ravel(), acceleration.ravel()])

        if len(moving):
            state = np.concatenate([start[moving].ravel(), velocities[moving].ravel()])
            solved = solve_ivp(motion, (0.0, dt), state, method="RK45", **self._tolerances)
            self.positions[moving], velocities[moving] = solved.y[:, -1].reshape(shape)
        for node in driven:
            self.positions[node] = seen[node]
        self.velocities = velocities
