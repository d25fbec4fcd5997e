"""Simulation of tissue under a needle that a robot steers: fine compiled steps for closed-loop experiments.

`dynamics.needle.loads` defines the forces. `simulate_insertion` needs the needle's whole motion in advance. Here the
motion is given piece by piece, and a whole insertion takes milliseconds.

The trapezoidal rule integrates the modes of a continuum. Cutting and friction change steeply at small sliding speeds.
Each step therefore solves equations for these forces. The modes do not describe the whole displacement of the nodes.
The missing part is the residual flexibility [macneal1971] times the present forces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from dynamics.arrays import Floats
from dynamics.forces.kernels import PackedNeedle, packed, steered_steps
from dynamics.forces.tangent import stable_step
from dynamics.integration.stepping import SAME_STEP
from dynamics.needle.loads import SHAFT, NeedleMechanics, NeedlePose, needle_load, node_weights, shaft
from dynamics.network.continuum import FREE
from dynamics.network.mass_spring import MassSpringNetwork, pack

FINEST_STEP = 1.0 / 1920.0
"""Longest step for springs [s]; numerical: after 0.5 s of insertion, the error of the target's position is below 2 µm
compared with the adaptive integrator, as `tests/dynamics/needle/test_steered.py` checks."""

SOLID_STEP = 1.0 / 960.0
"""Longest step for a continuum [s]; numerical: the error is 5 µm, see `tests/dynamics/needle/test_steered_solid.py`."""

SLIDES, SLID = 50, 1e-3
"""Largest number of iterations for the sliding speeds. The iterations end earlier if no speed changes by more than SLID
times the slip velocity; numerical."""

OF_STABLE = 0.25
"""For stiff springs, the longest step divided by `stable_step` [1]; numerical: in each step, the fastest vibration then
loses 0.1 % of its energy."""


@dataclass(frozen=True, slots=True, eq=False)
class NeedleMotion:
    """Straight motion of a needle until the next command.

    tip: present position [m], (dim,); velocity: axial and lateral velocity of the needle [m/s], (dim,)
    direction: unit vector along the needle, (dim,)
    inserted_m: present depth of the tip beyond the skin [m], negative outside
    """

    tip: Floats
    velocity: Floats
    direction: Floats
    inserted_m: float


@dataclass(frozen=True, slots=True, eq=False)
class SampledForces:
    """Outside forces on the free nodes [N], (n, n_free, dim). Sample k applies at the time k interval_s [s]."""

    forces: Floats
    interval_s: float

    def __post_init__(self) -> None:
        if len(self.forces) < 2:
            raise ValueError(f"sampled forces: expected two times or more, found {len(self.forces)}")

    def at(self, time_s: float) -> Floats:
        """The forces at a time [s], (n_free, dim)."""
        where = min(max(time_s / self.interval_s, 0.0), len(self.forces) - 1.000001)
        k = int(where)
        return np.asarray((k + 1.0 - where) * self.forces[k] + (where - k) * self.forces[k + 1])


def steady_state(network: MassSpringNetwork, places: Floats) -> Floats:
    """State at rest with the free nodes at given places [m], (n_free, dim). A continuum's modal state is appended."""
    state, solid = pack(places, np.zeros_like(places)), network.continuum
    if solid is None:
        return state
    force = solid.stiffness @ (places - network.positions[network.free]).ravel()
    modes = solid.shapes.T @ force / ((solid.rates + FREE**2) * solid.mass)
    return np.concatenate([state, modes, np.zeros_like(modes)])


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
    """State after an interval of time, (n,), and whether the skin is punctured at the end.

    state: state at the start, such as `steady_state`, (n,); punctured: whether the skin is punctured at the start
    between_s: start and end of the interval [s]
    needle: constants of the forces; the pose and the entry come from `motion`
    Raises ValueError if the interval ends before it starts.
    """
    start, end = between_s
    if not end >= start:
        raise ValueError(f"between_s: expected times that rise, found {between_s}")
    n_steps = max(1, int(np.ceil((end - start) / longest_step(network) * (1.0 - SAME_STEP))))
    dt = (end - start) / n_steps
    if network.continuum is not None:
        return _solid_steps(network, needle, state, motion, (outside, start, dt, n_steps), punctured)
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
    """Longest step [s]: SOLID_STEP for a continuum; for a network FINEST_STEP, or less for very stiff springs."""
    if network.continuum is not None:
        return SOLID_STEP
    return min(FINEST_STEP, OF_STABLE * stable_step(network))


def _solid_steps(
    network: MassSpringNetwork,
    needle: NeedleMechanics,
    state: Floats,
    motion: NeedleMotion,
    steps: tuple[SampledForces, float, float, int],
    punctured: bool,
) -> tuple[Floats, bool]:
    """State of a continuum after n steps of h, and whether the skin is punctured; steps: forces, start, h, n."""
    solid, (outside, start, dt, n) = network.continuum, steps
    assert solid is not None  # the caller checks it
    give, r, drawn = _residual(network), len(solid.rates), network.positions
    q, s = state[network.n_state : -r].copy(), state[-r:].copy()
    speed, entry = float(motion.velocity @ motion.direction), motion.tip - motion.inserted_m * motion.direction

    def pose(t: float) -> NeedlePose:
        gone = t - start
        return NeedlePose(
            motion.tip + gone * motion.velocity, motion.direction, speed, motion.inserted_m + gone * speed
        )

    at_entry = node_weights(network, entry, needle.reach_m)[network.free]
    along = np.outer(at_entry, motion.direction).ravel()
    # Contact and residual flexibility are in series
    in_series = 1.0 / (1.0 / needle.contact_N_m + max(0.0, float(along @ give @ along)))
    needle = replace(needle, pose=pose, entry=entry, contact_N_m=in_series)

    def nodes(values: Floats, at: Floats) -> Floats:
        found = at.copy()
        found[network.free] += values.reshape(-1, network.dim)
        return found

    def forces(t: float) -> tuple[Floats, float]:
        """Sum of all forces on the free coordinates [N], (n_free dim,), and the contact force [N]."""
        acting = outside.at(t).ravel()
        if pose(t).inserted_m <= 0.0:
            return acting, 0.0
        x, v = nodes(solid.shapes @ q + give @ acting, drawn), nodes(solid.shapes @ s, np.zeros_like(drawn))
        load = needle_load(network, needle, t, x, v, punctured=punctured)
        return acting + load.nodes[network.free].ravel(), float(load.contact)

    left = 1.0 + 0.5 * dt * solid.damping + 0.25 * dt**2 * solid.rates
    modes_along = np.einsum("idr,d->ir", solid.shapes.reshape(-1, network.dim, r), motion.direction)
    shared: Floats | None = None  # cutting and friction along the needle, by node [N]
    for k in range(n):
        t, shared = start + (k + 0.5) * dt, None
        slides = punctured and pose(t).inserted_m > 0.0
        acting, contact = (outside.at(t).ravel(), 0.0) if slides else forces(t)
        punctured = punctured or contact >= needle.puncture_N
        pull = acting @ solid.shapes / solid.mass - solid.rates * (q + 0.5 * dt * s) - solid.damping * s
        if slides:
            points, most = shaft(needle, pose(t))
            part = node_weights(network, points, needle.reach_m)[:, network.free]
            rows = part @ modes_along
            free = speed - rows @ (s + 0.5 * dt * pull / left)
            gives = 0.5 * dt / solid.mass * (rows / left) @ rows.T
            shared = _sliding(free, gives, most, needle.slip_m_s) @ part
            pull += shared @ modes_along / solid.mass
        w = dt * pull / left
        q += dt * (s + 0.5 * w)
        s += w
    end = start + n * dt
    # the speeds at the end of a step oscillate, so friction is taken from the middle of the last step
    acting = forces(end)[0] if shared is None else outside.at(end).ravel() + np.kron(shared, motion.direction)
    places = nodes(solid.shapes @ q + give @ acting, drawn)[network.free]
    speeds = (solid.shapes @ s).reshape(places.shape)
    return np.concatenate([pack(places, speeds), q, s]), punctured


def _sliding(free: Floats, gives: Floats, most: Floats, slip: float) -> Floats:
    """Cutting and friction forces f(u) [N], (n,), at the sliding speeds u that solve `u = free - gives f(u)`.

    free: speeds without these forces [m/s], (n,); gives: loss of each speed per unit of each force [m/s/N], (n, n)
    most: largest forces [N], (n,)
    """
    u, secant = free, np.zeros_like(most)
    for _ in range(SLIDES):
        secant = most / np.hypot(u, slip)
        secant[0] *= u[0] > 0.0  # nothing is cut backward
        before, u = u, np.asarray(np.linalg.solve(np.eye(len(free)) + gives * secant, free), dtype=float)
        if np.abs(u - before).max() <= SLID * slip:
            break
    return secant * u


@lru_cache(maxsize=16)
def _residual(network: MassSpringNetwork) -> Floats:
    """Cached `Continuum.residual` of a network's continuum [m/N], (n_free dim, n_free dim)."""
    assert network.continuum is not None  # the caller checks it
    return network.continuum.residual


def sliding_friction(
    network: MassSpringNetwork, needle: NeedleMechanics, tips: ArrayLike, direction: Floats, depths: Floats
) -> Floats:
    """Forces on the free nodes [N], (n, n_free, dim), due to a needle with full cutting force and full friction.

    tips: positions of the tip after the puncture [m], (n, dim); direction: unit vector along the needle, (dim,)
    depths: depths of the tip in the tissue [m], (n,)
    """
    deep = np.maximum(0.0, np.asarray(depths, dtype=float))
    back = 0.5 * deep[:, None] * (SHAFT[0] + 1.0)
    points = np.asarray(tips, dtype=float)[:, None] - np.c_[np.zeros(len(deep)), back][:, :, None] * direction
    most = np.c_[np.full(len(deep), needle.cutting_N), needle.friction_N_m * 0.5 * deep[:, None] * SHAFT[1]]
    shared = np.einsum("nq,nqi->ni", most, node_weights(network, points, needle.reach_m))
    return np.asarray(shared[:, network.free, None] * direction)
