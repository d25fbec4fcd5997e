"""Known force on the tissue, such as the force of a needle, evaluated at each step of a prediction."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from dynamics import MassSpringNetwork
from estimators.arrays import Floats

ForceHistory = ArrayLike | Callable[[float, Floats], ArrayLike]
"""Known forces on the free nodes [N]: constant forces, (n_free, dim), or a function that is called once per step.

Arguments of the function are the time [s] at the middle of the step, and the states, (..., n_state), at the start of
the step. The function returns the forces during the step, (..., n_free, dim) or (n_free, dim). A step takes at most
1/120 s. Friction must be too weak to reverse the velocity within a step. Otherwise, the velocity oscillates."""


class KnownForce:
    """Known force on the tissue, evaluated step by step during a prediction.

    State: time_s, the end of the present step [s]; dt, the length of the present step [s].
    """

    def __init__(self, push: ForceHistory, network: MassSpringNetwork, time_s: float) -> None:
        self.time_s, self.dt = time_s, 0.0
        self._push = push
        self._shape = (len(network.free), network.dim)
        if not callable(push):
            self._held = self._flat(push)

    def step(self, dt: float) -> None:
        """Begin the next step, with the length dt [s]."""
        self.time_s, self.dt = self.time_s + dt, dt

    def forces(self, states: Floats) -> Floats:
        """Forces on the free coordinates [N], (..., n_free dim), in states (..., n_state) at the start of the step.

        Raises ValueError if a force is not finite, or if the forces have none of the shapes in `ForceHistory`.
        """
        if callable(self._push):
            return self._flat(self._push(self.time_s - 0.5 * self.dt, states), states.shape[:-1])
        return self._held

    def _flat(self, push: ArrayLike, lead: tuple[int, ...] = ()) -> Floats:
        force = np.asarray(push, dtype=float)
        if force.shape not in (self._shape, (*lead, *self._shape)) or not np.isfinite(force).all():
            raise ValueError(
                f"push: expected finite forces of shape {self._shape}, found {force.shape}, "
                + ("all finite" if np.isfinite(force).all() else "not all finite")
            )
        return force.reshape(*force.shape[:-2], -1)
