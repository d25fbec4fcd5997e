"""Needle forces of contact, cutting and friction: a known input of the tissue's equations of motion.

Before the puncture, the skin resists the tip like a spring. After the puncture, the tip cuts with a constant force, and
there is friction along the shaft. This decomposition follows [okamura2004] and [simone2002].

    contact   F = k (depth of the tip beyond the skin)          until F reaches the puncture force
    cutting   F = f_c s(v)  at the tip, forward only
    friction  F = f_f s(v)  per length, all along the shaft     s(v) = v / sqrt(v² + slip²)

with v the axial speed of the needle relative to the adjacent tissue. Each force acts on a point of the tissue, whose
displacement is a weighted mean of the nodes' displacements. The same weights distribute the force over the nodes, so
that the work at the point equals the work on the nodes.

This differs from [okamura2004]: their modified Karnopp model has a dead band with stiction. Here Coulomb friction
rises smoothly over `slip_m_s`, as an integrator requires. The needle is straight and rigid and exerts no lateral force.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dynamics.arrays import Floats
from dynamics.forces.kernels import contact_force, sliding_force
from dynamics.network.mass_spring import MassSpringNetwork

GAUGES_MM = {14: 2.1, 16: 1.6, 18: 1.2, 20: 0.9, 22: 0.7}
"""Nominal outer diameters of needles by gauge [mm]; source: [iso9626]."""

SHAFT = np.polynomial.legendre.leggauss(8)
"""Gauss-Legendre points and weights on (-1, 1) for shaft friction; numerical: exact up to polynomial degree 15."""


@dataclass(frozen=True, slots=True, eq=False)
class NeedlePose:
    """Position, direction and speed of a needle at one time.

    tip: position [m], (dim,); direction: unit vector of insertion, (dim,)
    speed: speed along the direction [m/s], negative during retraction; inserted_m: length of shaft in the tissue [m]
    """

    tip: Floats
    direction: Floats
    speed: float
    inserted_m: float


@dataclass(frozen=True, slots=True, eq=False)
class NeedleMechanics:
    """Motion of a needle, and the constants of its forces; `docs/needle.md` explains these constants.

    pose: function from time [s] to the needle's pose; entry: point where the needle meets the skin at rest [m], (dim,)
    radius_m: radius of the shaft [m]
    puncture_N: contact force at which the skin is punctured [N]
    contact_N_m: contact force per depth of the dent before the puncture [N/m]
    cutting_N: cutting force at the tip [N]; friction_N_m: friction along the shaft, per length [N/m]
    reach_m: width of the kernel that distributes a force [m]
    slip_m_s: sliding speed at which friction reaches 71 % of its full value [m/s]

    The defaults define the simulated needle, of 16 gauge, in a soft phantom; they are not settings of an estimator.
    Raises ValueError for impossible values.
    """

    pose: Callable[[float], NeedlePose]
    entry: Floats
    radius_m: float = 0.5e-3 * GAUGES_MM[16]
    puncture_N: float = 2.0  # noqa: N815
    contact_N_m: float = 400.0  # noqa: N815
    cutting_N: float = 1.0  # noqa: N815
    friction_N_m: float = 15.0  # noqa: N815
    reach_m: float = 0.06
    slip_m_s: float = 2e-3

    def __post_init__(self) -> None:
        object.__setattr__(self, "entry", np.array(self.entry, dtype=float))
        for key in ("radius_m", "puncture_N", "contact_N_m", "reach_m", "slip_m_s"):
            if not 0.0 < getattr(self, key) < np.inf:
                raise ValueError(f"needle {key}: expected more than 0, found {getattr(self, key):g}")
        for key in ("cutting_N", "friction_N_m"):
            if not 0.0 <= getattr(self, key) < np.inf:
                raise ValueError(f"needle {key}: expected 0 or more, found {getattr(self, key):g}")


@dataclass(frozen=True, slots=True, eq=False)
class NeedleLoad:
    """Forces between needle and tissue at one time, for one state or for a batch of states of the shape (...).

    nodes: force on each node, including anchors [N], (..., n_nodes, dim)
    on_needle: force of the tissue on the needle, as a sensor at the hub reads it [N], (..., dim)
    contact, cutting, friction: parts of the axial force on the tissue [N], (...)
    """

    nodes: Floats
    on_needle: Floats
    contact: Floats
    cutting: Floats
    friction: Floats


def straight_insertion(
    entry: ArrayLike, towards: ArrayLike, speed: float, *, start_s: float = 0.0, depth_m: float = np.inf
) -> Callable[[float], NeedlePose]:
    """Function from time [s] to the pose of a needle that moves on a line with constant speed [m/s].

    entry: point that the tip reaches at start_s [m], (dim,); towards: a point on the line beyond the entry [m], (dim,)
    depth_m: depth beyond the entry at which the needle stops [m]
    Raises ValueError if entry and towards are equal.
    """
    from_, to = np.asarray(entry, dtype=float), np.asarray(towards, dtype=float)
    length = float(np.linalg.norm(to - from_))
    if not length > 0.0:
        raise ValueError(f"towards: expected a point beyond the entry, found {to} m for both")
    direction = (to - from_) / length

    def pose(t: float) -> NeedlePose:
        gone = speed * (t - start_s)
        along = min(gone, depth_m)
        return NeedlePose(from_ + along * direction, direction, speed if gone < depth_m else 0.0, max(0.0, along))

    return pose


def node_weights(network: MassSpringNetwork, points: ArrayLike, reach_m: float) -> Floats:
    """Weights that distribute a force at each point over the nodes, (..., n_nodes). Their sum is one.

    points: positions [m], (..., dim)
    The weights are a Gaussian kernel of the distance to the nodes in the drawn shape. Far from all nodes, the nearest
    node gets the whole force.
    """
    apart = np.asarray(points, dtype=float)[..., None, :] - network.positions
    exponent = -0.5 * np.einsum("...d,...d->...", apart, apart) / reach_m**2
    kernel = np.exp(exponent - exponent.max(axis=-1, keepdims=True))
    return np.asarray(kernel / kernel.sum(axis=-1, keepdims=True))


def indentation(network: MassSpringNetwork, needle: NeedleMechanics, t: float, positions: ArrayLike) -> Floats:
    """Depth of the tip beyond the skin [m], (...). It is negative before contact. The skin moves with the nodes.

    positions: positions of all nodes [m], (..., n_nodes, dim)
    """
    given_way = node_weights(network, needle.entry, needle.reach_m) @ (np.asarray(positions) - network.positions)
    return _dent(needle, needle.pose(t), given_way)


def _dent(needle: NeedleMechanics, pose: NeedlePose, given_way: Floats) -> Floats:
    return np.asarray((pose.tip - needle.entry - given_way) @ pose.direction)


def needle_load(
    network: MassSpringNetwork,
    needle: NeedleMechanics,
    t: float,
    positions: ArrayLike,
    velocities: ArrayLike,
    *,
    punctured: bool,
) -> NeedleLoad:
    """Compute the forces between needle and tissue at time t [s].

    positions, velocities: positions [m] and velocities [m/s] of all nodes, (..., n_nodes, dim) each
    punctured: whether the skin is punctured
    """
    x, v = np.asarray(positions, dtype=float), np.asarray(velocities, dtype=float)
    pose, nothing = needle.pose(t), np.zeros(x.shape[:-2])
    if not punctured:
        part = node_weights(network, needle.entry[None], needle.reach_m)
        contact = np.asarray(contact_force(_dent(needle, pose, part[0] @ (x - network.positions)), needle.contact_N_m))
        along = contact[..., None]
        cutting = friction = nothing
    else:
        points, most = shaft(needle, pose)
        part = node_weights(network, points, needle.reach_m)
        slide = pose.speed - (v @ pose.direction) @ part.T
        along = np.asarray(sliding_force(slide, most, needle.slip_m_s))
        along[..., 0] = np.maximum(0.0, along[..., 0])
        contact, cutting, friction = nothing, along[..., 0], along[..., 1:].sum(axis=-1)
    nodes = (along @ part)[..., None] * pose.direction
    return NeedleLoad(nodes, -(contact + cutting + friction)[..., None] * pose.direction, contact, cutting, friction)


def distributed_force(
    network: MassSpringNetwork, needle: NeedleMechanics, t: float, push_N: float, *, punctured: bool
) -> Floats:
    """Measured axial force, distributed over the free nodes [N], (n_free, dim), as a known input of a filter.

    push_N: force on the tissue along the needle [N]; a sensor at the hub reads the opposite force
    Before the puncture, the force acts at the entry. After the puncture, it is distributed over tip and shaft in
    proportion to the largest cutting and friction forces.
    """
    pose = needle.pose(t)
    points, parts = needle.entry[None], np.ones(1)
    if punctured:
        points, most = shaft(needle, pose)
        parts = most / most.sum()
    everywhere = push_N * (parts @ node_weights(network, points, needle.reach_m))[:, None] * pose.direction
    return np.asarray(everywhere[network.free])


def shaft(needle: NeedleMechanics, pose: NeedlePose) -> tuple[Floats, Floats]:
    """Tip and points of the shaft [m], (n, dim), and the largest cutting or friction force at each point [N], (n,)."""
    back = 0.5 * pose.inserted_m * (SHAFT[0] + 1.0)
    points = pose.tip - np.r_[0.0, back][:, None] * pose.direction
    return points, np.r_[needle.cutting_N, needle.friction_N_m * 0.5 * pose.inserted_m * SHAFT[1]]
