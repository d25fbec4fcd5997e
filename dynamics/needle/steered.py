"""The tissue under a needle that a robot steers: fine compiled steps for experiments that close the loop.

The forces are those of `dynamics.needle.loads`. `simulate_insertion` follows one needle whose motion is known
beforehand, by DOP853; here the motion is given piece by piece, and a whole insertion takes milliseconds. The tests
compare the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from dynamics.arrays import Floats
from dynamics.forces.kernels import PackedNeedle, packed, steered_steps
from dynamics.forces.tangent import stable_step
from dynamics.integration.stepping import SAME_STEP
from dynamics.needle.loads import SHAFT, NeedleMechanics, node_weights
from dynamics.network.mass_spring import MassSpringNetwork

FINEST_STEP = 1.0 / 1920.0
"""Longest step [s]: numerical, the target is within 2 µm of the adaptive integrator's after 0.5 s of insertion, which
`tests/dynamics/needle/test_steered.py` checks."""

OF_STABLE = 0.25
"""Longest step as a share of the longest stable one; numerical: the fastest vibration is damped by 0.1 % a step."""


@dataclass(frozen=True, slots=True, eq=False)
class NeedleMotion:
    """The straight motion of a needle until the next command.

    tip: where it is now [m], (dim,); velocity: of the needle, along and across itself [m/s], (dim,)
    direction: of length 1, (dim,); inserted_m: how deep the tip is in the tissue now, below 0 before the skin [m]
    """

    tip: Floats
    velocity: Floats
    direction: Floats
    inserted_m: float


@dataclass(frozen=True, slots=True, eq=False)
class SampledForces:
    """Outside forces on the free nodes [N], (n, n_free, dim), every interval_s [s] from time 0, linear in between."""

    forces: Floats
    interval_s: float


def advance_steered(
    network: MassSpringNetwork,
    needle: NeedleMechanics,
    state: Floats,
    motion: NeedleMotion,
    *,
    outside: SampledForces,
    between_s: tuple[float, float],
    punctured: bool,
) -> tuple[Floats, bool]:
    """State (n_state,) at the later of two times [s] and whether the skin is punctured by then, from the earlier.

    needle: for its constants; its pose and entry are not used
    Raises ValueError where time goes back.
    """
    start, end = between_s
    if not end >= start:
        raise ValueError(f"between_s: expected times that rise, found {between_s}")
    n_steps = max(1, int(np.ceil((end - start) / longest_step(network) * (1.0 - SAME_STEP))))
    dt = (end - start) / n_steps
    inverse_mass = np.zeros(network.n_nodes)
    inverse_mass[network.free] = 1.0 / network.masses[network.free]
    moved, gave_way = steered_steps(
        np.ascontiguousarray(state, dtype=float),
        outside.forces.reshape(len(outside.forces), -1),
        (start / outside.interval_s, dt / outside.interval_s),
        dt,
        n_steps,
        network.positions,
        network.free,
        inverse_mass,
        packed(network),
        PackedNeedle(
            needle.puncture_N,
            needle.contact_N_m,
            needle.cutting_N,
            needle.friction_N_m,
            needle.reach_m,
            needle.slip_m_s,
        ),
        (motion.tip, motion.velocity, motion.direction, float(motion.inserted_m)),
        punctured,
        np.ascontiguousarray(SHAFT),
    )
    return moved, bool(gave_way)


@lru_cache(maxsize=16)
def longest_step(network: MassSpringNetwork) -> float:
    """Longest step taken [s]: FINEST_STEP, or less where stiff springs or dashpots would make that unstable."""
    return min(FINEST_STEP, OF_STABLE * stable_step(network))


def sliding_friction(
    network: MassSpringNetwork, needle: NeedleMechanics, tips: ArrayLike, direction: Floats, depths: Floats
) -> Floats:
    """Forces on the free nodes [N], (n, n_free, dim), of a needle that slides on with its tip at these places.

    tips: [m], (n, dim), punctured; depths: of the tip in the tissue [m], (n,). Full cutting and friction, whatever the
    tissue's own velocity.
    """
    deep = np.maximum(0.0, np.asarray(depths, dtype=float))
    back = 0.5 * deep[:, None] * (SHAFT[0] + 1.0)
    points = np.asarray(tips, dtype=float)[:, None] - np.c_[np.zeros(len(deep)), back][:, :, None] * direction
    most = np.c_[np.full(len(deep), needle.cutting_N), needle.friction_N_m * 0.5 * deep[:, None] * SHAFT[1]]
    shared = np.einsum("nq,nqi->ni", most, node_weights(network, points, needle.reach_m))
    return np.asarray(shared[:, network.free, None] * direction)
