"""Simulation of tissue under a needle: Runge-Kutta steps with state-dependent forces, and whole insertions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from dynamics.arrays import Floats
from dynamics.integration.stepping import motion
from dynamics.needle.loads import NeedleMechanics, indentation, needle_load
from dynamics.network.mass_spring import MassSpringNetwork, all_positions, unpack

LONGEST_STEP = 0.01
"""Longest step of the adaptive integrator [s]; numerical: a longer step could miss the moment of contact. At 50 mm/s,
the tip advances by half a millimetre per step."""


@dataclass(frozen=True, slots=True, eq=False)
class InsertionHistory:
    """States, forces and puncture of a simulated insertion over time.

    times_s: times [s], (n_times,); states: states of the network, (n_times, n_state)
    axial_forces: axial force of the needle on the tissue [N], (n_times,)
    punctured_s: time at which the skin was punctured [s]; None without puncture
    """

    times_s: Floats
    states: Floats
    axial_forces: Floats
    punctured_s: float | None

    @property
    def punctured(self) -> NDArray[np.bool_]:
        """Whether the skin is punctured at each time, (n_times,)."""
        return self.times_s > (np.inf if self.punctured_s is None else self.punctured_s)


def force_on_free(
    network: MassSpringNetwork, needle: NeedleMechanics, *, punctured: bool
) -> Callable[[float, Floats], Floats]:
    """Function from time [s] and states (..., n_state) to needle forces on the free nodes [N], (..., n_free, dim)."""
    lead = network.positions

    def force(t: float, states: Floats) -> Floats:
        places, speeds = unpack(states, network.dim)
        x = np.broadcast_to(lead, (*places.shape[:-2], *lead.shape)).copy()
        v = np.zeros_like(x)
        x[..., network.free, :], v[..., network.free, :] = places, speeds
        return needle_load(network, needle, t, x, v, punctured=punctured).nodes[..., network.free, :]

    return force


def forced_states(
    network: MassSpringNetwork,
    state: Floats,
    force: Callable[[float, Floats], Floats],
    times: ArrayLike,
    n_steps: int = 1,
) -> Floats:
    """States at the times [s], (n_times, n_state). Each interval has n_steps classical Runge-Kutta steps.

    force(t, state): force on the free nodes [N], (n_free, dim); it is computed at each stage of a step
    """
    t = np.asarray(times, dtype=float)
    rate = motion(network)
    found = np.empty((len(t), network.n_state))
    found[0] = y = np.asarray(state, dtype=float)
    for k in range(1, len(t)):
        h = (t[k] - t[k - 1]) / n_steps
        for i in range(n_steps):
            now = t[k - 1] + i * h
            k1 = rate(y, force(now, y))
            k2 = rate(y + 0.5 * h * k1, force(now + 0.5 * h, y + 0.5 * h * k1))
            k3 = rate(y + 0.5 * h * k2, force(now + 0.5 * h, y + 0.5 * h * k2))
            k4 = rate(y + h * k3, force(now + h, y + h * k3))
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        found[k] = y
    return found


def simulate_insertion(
    network: MassSpringNetwork,
    needle: NeedleMechanics,
    state: Floats,
    times: ArrayLike,
    *,
    outside: Callable[[float], ArrayLike] = lambda _t: 0.0,
    rtol: float = 1e-8,
    atol: float = 1e-10,
) -> InsertionHistory:
    """Simulate the tissue under a needle with SciPy's DOP853, from `state` at the first of the times [s].

    outside(t): other forces on the free nodes [N], (n_free, dim)
    The skin is punctured when the contact force reaches the puncture force; the integration restarts at this time.
    Raises RuntimeError if the integrator fails.
    """
    t = np.asarray(times, dtype=float)
    rate = motion(network)

    def positions(y: Floats) -> Floats:
        return all_positions(network, unpack(y, network.dim)[0])

    def strength(now: float, y: Floats) -> float:
        return needle.contact_N_m * float(indentation(network, needle, now, positions(y))) - needle.puncture_N

    strength.terminal = True  # type: ignore[attr-defined]
    strength.direction = 1.0  # type: ignore[attr-defined]
    options = {"method": "DOP853", "rtol": rtol, "atol": atol, "max_step": LONGEST_STEP}
    states = np.empty((len(t), network.n_state))
    began, y, punctured_s = float(t[0]), np.asarray(state, dtype=float), None
    done = 0
    for punctured in (False, True):
        force = force_on_free(network, needle, punctured=punctured)
        solved = solve_ivp(
            lambda now, s, force=force: rate(s, force(now, s) + np.asarray(outside(now))),
            (began, t[-1]),
            y,
            t_eval=t[done:],
            events=None if punctured else strength,
            **options,
        )
        if not solved.success:
            raise RuntimeError(f"insertion from {began:.6g} to {t[-1]:.6g} s: {solved.message}")
        states[done : done + len(solved.t)] = solved.y.T
        done += len(solved.t)
        if punctured or solved.status != 1 or done == len(t):
            break
        began = punctured_s = float(solved.t_events[0][0])
        y = solved.y_events[0][0]
    axial_forces = np.empty(len(t))
    for k, (now, own) in enumerate(zip(t, states, strict=True)):
        open_ = punctured_s is not None and now > punctured_s
        places, speeds = positions(own), np.zeros_like(network.positions)
        speeds[network.free] = unpack(own, network.dim)[1]
        load = needle_load(network, needle, float(now), places, speeds, punctured=open_)
        axial_forces[k] = load.contact + load.cutting + load.friction
    return InsertionHistory(t, states, axial_forces, punctured_s)
