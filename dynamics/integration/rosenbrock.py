"""ROS2: an implicit time step of second order for assembled elements, and the derivative of this step.

    M q'' = F(q, q') + M B f,    f' = -f / tau

The state contains the coordinates q, their rates q' and the decaying accelerations f. The step is L-stable: it damps
stiff oscillations, but slow ones hardly lose energy. Source: [verwer1999], with gamma = 1 - 1 / sqrt(2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynamics.arrays import Floats
from dynamics.elements.assembly import Assembly
from dynamics.elements.reduced import ReducedAssembly
from dynamics.integration.kernels import GAMMA, ONCE, TWICE, along_steps, by_push, by_state, first_stage, second_stage
from dynamics.integration.stepping import SAME_STEP

SHORTEST_SHARE = 1.0 / 128.0
"""Shortest step divided by the whole interval [1]; numerical. A step of this length is accepted, whatever its error."""


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """One step: its length [s], and the state after the step, (n_state,).

    by_state: derivative of the new coordinates and velocities with respect to the old state, (2 n, n_state)
    fading: factor by which each decaying acceleration of the state changes in the step, (n_f,)
    S [1/kg], (n, n), K [N/m], (n, n), M [kg], (n,): matrices of the step as in `dynamics.integration.kernels`
    """

    step_s: float
    state: Floats
    by_state: Floats
    fading: Floats
    S: Floats
    K: Floats
    M: Floats

    def pushed(self, accelerations: Floats) -> Floats:
        """Change of coordinates and velocities in the step, (2 n, k), due to constant accelerations [m/s²], (n, k)."""
        return np.asarray(by_push(self.step_s, self.S, self.K, self.M, np.ascontiguousarray(accelerations)))


def along(moves: Sequence[Move], sources: NDArray[np.int64], n_sources: int, white: Floats) -> tuple[Floats, ...]:
    """Jacobian (2 n, m), decay (n_f,), noise covariances (1 + n_sources, m, m), as `kernels.along_steps` has them."""
    by_states, fadings = np.array([move.by_state for move in moves]), np.array([move.fading for move in moves])
    steps_s = np.array([move.step_s for move in moves])
    return tuple(along_steps(by_states, fadings, steps_s, sources, n_sources, white))


class Rosenbrock:
    """Integrator for coordinates [m] and velocities [m/s], (n,) each, and decaying accelerations f [m/s²], (n_f,).

    Parameters
    ----------
    assembly : Assembly or ReducedAssembly
    masses : (n,)
        Mass of each free coordinate [kg].
    basis : (n, n_f)
        Acceleration of each coordinate per unit of each entry of f [1].
    fading_s : (n_f,)
        Correlation times of f [s].
    tolerance_m : float
        Difference between the two stages above which a step is halved [m].
    """

    def __init__(
        self,
        assembly: Assembly | ReducedAssembly,
        masses: Floats,
        basis: Floats,
        fading_s: Floats,
        tolerance_m: float,
    ) -> None:
        self.assembly, self.masses, self.basis = assembly, masses, basis
        self.rates, self.tolerance_m = 1.0 / fading_s, tolerance_m

    def moves(self, state: Floats, dt: float, longest_s: float, *, derivatives: bool = True) -> list[Move]:
        """Integrate from a state (n_state,) over dt [s], in steps of at most longest_s [s]; returns the steps.

        derivatives: whether to compute `by_state`, which takes most of the time; if not, `by_state` is empty
        """
        M, B, rates, n = self.masses, self.basis, self.rates, len(self.masses)
        h = longest = dt / max(1, int(np.ceil(dt / longest_s * (1.0 - SAME_STEP))))
        done, moves = 0.0, []
        while done < dt * (1.0 - 1e-9):
            h = min(h, dt - done)
            force, K, C = self.assembly.linearised(state[:n], state[n : 2 * n])
            while True:
                S, first, first_f, middle = first_stage(state, h, force, K, C, M, B, rates)
                pull = self.assembly.force(middle[:n], middle[n:])
                moved, error = second_stage(state, h, first, first_f, middle, pull, S, K, M, B, rates)
                if error < self.tolerance_m or h <= SHORTEST_SHARE * dt:
                    break
                h *= 0.5
            state = moved
            derivative = by_state(h, S, K, M, B, rates) if derivatives else np.empty((0, 0))
            kept = 1.0 / (1.0 + GAMMA * h * rates)
            moves.append(Move(h, state, derivative, TWICE * kept**2 + ONCE * kept, S, K, M))
            done += h
            if error < 0.1 * self.tolerance_m:
                h = min(2.0 * h, longest)
        return moves
