"""An implicit step of second order for assembled elements, with its derivative: ROS2.

    M q'' = F(q, q') + M B f,    f' = -f / tau

f are accelerations that fade, so that a filter can carry them in its state. L-stable: stiff oscillations die away, slow
ones keep their energy to second order. Source: [verwer1999], with gamma = 1 - 1 / sqrt(2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynamics.arrays import Floats
from dynamics.elements.assembly import Assembly

GAMMA = 1.0 - 1.0 / np.sqrt(2.0)
TWICE, ONCE = (1.0 - GAMMA) / GAMMA, -(1.0 - 2.0 * GAMMA) / GAMMA
"""The stability function in powers of the resolvent A = 1 / (1 - gamma h J): TWICE A² + ONCE A."""

SHORTEST_SHARE = 1.0 / 128.0
"""Of the whole way, the shortest step, however large its error [1]; numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """One step: its length [s], the state after it (n_state,), and derivative of that by the state before.

    by_state: rows of coordinates and velocities, (2 n, n_state); fading: of each acceleration, (n_f,)
    """

    step_s: float
    state: Floats
    by_state: Floats
    fading: Floats


class Rosenbrock:
    """Steps of a state of coordinates [m], velocities [m/s], (n,) each, and accelerations [m/s²], (n_f,).

    Parameters
    ----------
    assembly : Assembly
    masses : (n,)
        Of each free coordinate [kg].
    basis : (n, n_f)
        Acceleration of each coordinate by each of the fading ones.
    fading_s : (n_f,)
        Their correlation times [s].
    tolerance_m : float
        Difference of the two stages beyond which a step is halved [m].
    """

    def __init__(self, assembly: Assembly, masses: Floats, basis: Floats, fading_s: Floats, tolerance_m: float) -> None:
        self.assembly, self.masses, self.basis = assembly, masses, basis
        self.rates, self.tolerance_m = 1.0 / fading_s, tolerance_m

    def moves(self, state: Floats, dt: float, longest_s: float, *, derivatives: bool = True) -> list[Move]:
        """The steps from a state (n_state,) over dt [s], none longer than longest_s [s].

        Without derivatives `by_state` is empty, for a fraction of the time.
        """
        n, M, B = len(self.masses), self.masses, self.basis
        h = longest = dt / max(1, int(np.ceil(dt / longest_s - 1e-9)))
        done, moves = 0.0, []
        while done < dt * (1.0 - 1e-9):
            h = min(h, dt - done)
            q, v, f = state[:n], state[n : 2 * n], state[2 * n :]
            force = self.assembly.force(q, v)
            K, C = (matrix.toarray() for matrix in self.assembly.tangents(q, v))
            while True:
                g = GAMMA * h
                S = np.linalg.inv(np.diag(M) + g * C + g * g * K)
                kept = 1.0 / (1.0 + g * self.rates)
                first_f = -self.rates * f * kept
                first = _resolved(S, K, M, g, v, force / M + B @ (f + g * first_f))
                middle = state[: 2 * n] + h * first
                f_middle = f + h * first_f
                second_f = (-self.rates * f_middle - 2.0 * first_f) * kept
                pull = self.assembly.force(middle[:n], middle[n:]) / M + B @ (f_middle + g * second_f)
                second = _resolved(S, K, M, g, middle[n:] - 2.0 * first[:n], pull - 2.0 * first[n:])
                error = float(np.abs(0.5 * h * (first + second)[:n]).max())
                if error < self.tolerance_m or h <= SHORTEST_SHARE * dt:
                    break
                h *= 0.5
            moved = state[: 2 * n] + 1.5 * h * first + 0.5 * h * second
            state = np.concatenate([moved, f + 1.5 * h * first_f + 0.5 * h * second_f])
            by_state = self._by_state(S, K, g, kept) if derivatives else np.empty((0, 0))
            moves.append(Move(h, state, by_state, TWICE * kept**2 + ONCE * kept))
            done += h
            if error < 0.1 * self.tolerance_m:
                h = min(2.0 * h, longest)
        return moves

    def _by_state(self, S: Floats, K: Floats, g: float, kept: Floats) -> Floats:
        """Derivative of coordinates and velocities after a step by the state before, (2 n, n_state)."""
        n, M, B = len(self.masses), self.masses, self.basis
        A = np.empty((2 * n, 2 * n))
        A[n:, :n], A[n:, n:] = -g * (S @ K), S * M
        A[:n] = g * A[n:]
        A[:n, :n] += np.eye(n)
        by_f = A[:, n:] @ B
        fading = g * kept * (TWICE * (A @ by_f + by_f * kept) + ONCE * by_f)
        return np.hstack([TWICE * (A @ A) + ONCE * A, fading])


def _resolved(S: Floats, K: Floats, M: Floats, g: float, of_q: Floats, of_v: Floats) -> Floats:
    """(1 - g J)^-1 of rates of coordinates and velocities, (n,) each, as one vector (2 n,)."""
    speed = S @ (M * of_v - g * (K @ of_q))
    return np.concatenate([of_q + g * speed, speed])
