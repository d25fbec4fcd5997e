"""A known force on the tissue, such as a needle's, as the steps of a filter's prediction ask for it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from dynamics import MassSpringNetwork
from estimators.arrays import Floats

ForceHistory = ArrayLike | Callable[[float, Floats], ArrayLike]
"""Forces on the free nodes [N], (n_free, dim), held over the prediction; or a function of time [s] and states.

The function is asked once a step of at most 1/120 s, for the middle of the step and states (..., n_state) at its start,
and gives (..., n_free, dim) or (n_free, dim). What it gives is held over the step: a friction that turns round within a
step must not depend on the state, or it shakes.
"""


class KnownForce:
    """A known push, evaluated step by step during a prediction.

    State: time_s, at the end of the step under way; dt, its length [s].
    """

    def __init__(self, push: ForceHistory, network: MassSpringNetwork, time_s: float) -> None:
        self.time_s, self.dt = time_s, 0.0
        self._push = push
        self._shape = (len(network.free), network.dim)
        if not callable(push):
            self._held = self._flat(push)

    def step(self, dt: float) -> None:
        """Go on to the next step, of dt [s]."""
        self.time_s, self.dt = self.time_s + dt, dt

    def forces(self, states: Floats) -> Floats:
        """Forces on the free coordinates [N], (..., n_free dim), for states (..., n_state) at the start of the step.

        Raises ValueError for forces of another shape or that are not finite.
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
