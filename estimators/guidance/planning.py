"""Planning of needle paths: straight paths, ranked by the probability that the tip ends in the lesion.

The needle displaces the target by `u = C F`. The matrix `C` gives the displacement of the target per unit force on each
node, from the inverse stiffness matrix at rest [dimaio2003]. The vector `F` contains the needle's forces on the nodes
at arrival. These are the cutting force at the tip and the full friction along the shaft, distributed over the nodes as
in `dynamics.needle.loads`. Each path aims at the displaced target. Obstacles are assumed to be at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynamics import GAUGES_MM, SHAFT, MassSpringNetwork, node_weights, rest_shape, stiffness_matrix
from estimators.arrays import Floats
from estimators.guidance.kernels import ball_hits
from estimators.guidance.obstacles import Obstacle, clearances
from estimators.process.target import TargetPoint, target_map

AIMING = 6
"""Number of fixed-point iterations that find the displaced target; numerical: for the phantom, its position then has an
error of 0.3 µm. Half or twice as many iterations change all hit probabilities by less than 0.1 %."""

SAME = 3
"""Number of decimals to which hit probabilities are rounded for comparison and display. Of two paths with equal rounded
probabilities, the one with more clearance ranks first. For the phantom, two to six decimals give the same best path."""


@dataclass(frozen=True, slots=True, eq=False)
class PlannedTarget:
    """A spherical lesion at arrival: mean [m], (dim,), and covariance [m²], (dim, dim), of its centre; radius [m]."""

    mean: Floats
    cov: Floats
    radius_m: float


@dataclass(frozen=True, slots=True)
class PlannedNeedle:
    """Needle of a plan; `dynamics.NeedleMechanics` defines its forces.

    radius_m: radius of the shaft [m]; source: 16 gauge, a common core needle
    cutting_N: force at the tip [N]; source: plan.toml, by default 0.94 N in bovine liver, rounded, [okamura2004]
    friction_N_m: friction per length of shaft [N/m]; source: plan.toml, by default between 11 N/m for sliding
        and 18 N/m for sticking in bovine liver, [okamura2004]
    reach_m: width of the kernel that distributes a force over nodes [m]; choice
    force_sd: relative standard deviation of the forces; choice
    tip_sd_m: standard deviation of the tip about its path, on each axis [m]; source: plan.toml, by default
        0.9 mm at 45 mm, rounded, the mean deflection of a biopsy gun in a phantom, [deflection]
    """

    radius_m: float = 0.5e-3 * GAUGES_MM[16]
    cutting_N: float = 1.0  # noqa: N815
    friction_N_m: float = 15.0  # noqa: N815
    reach_m: float = 0.06
    force_sd: float = 0.3
    tip_sd_m: float = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """Region where the needle may enter: a box, which may be flat.

    start, end: opposite corners of the box [m], (dim,); normal: unit vector out of the tissue, (dim,)
    max_angle_rad: largest angle between a path and the normal [rad]; max_length_m: largest length of a path [m]
    """

    start: Floats
    end: Floats
    normal: Floats
    max_angle_rad: float = np.pi / 2
    max_length_m: float = np.inf

    def __post_init__(self) -> None:
        for key in ("start", "end", "normal"):
            object.__setattr__(self, key, np.array(getattr(self, key), dtype=float))
        length = float(np.linalg.norm(self.normal))
        if not length > 0.0:
            raise ValueError("skin normal: expected a non-zero vector, found 0")
        object.__setattr__(self, "normal", self.normal / length)

    def entries(self, n: int) -> Floats:
        """About n points in the region [m], (n, dim): on a straight line in the plane, on a grid in space."""
        if len(self.start) == 2:
            return self.start + np.linspace(0.0, 1.0, n)[:, None] * (self.end - self.start)
        sides = np.abs(self.end - self.start)
        wide = np.flatnonzero(sides > 0.0)
        step = (float(np.prod(sides[wide])) / n) ** (1.0 / max(1, len(wide)))
        counts = [max(1, round(side / step)) if side > 0.0 else 1 for side in sides]
        grids = [np.linspace(a, b, k) for a, b, k in zip(self.start, self.end, counts, strict=True)]
        return np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Needle paths with predicted results, in the order in which they were given.

    entries, tips: ends of each path [m], (n, dim); directions: unit vectors along the paths, (n, dim)
    lengths: lengths of the paths [m], (n,)
    pushed: displacement of the target by the needle [m], (n, dim)
    means: position of the target at arrival [m], (n, dim)
    covs: covariance of the target relative to the tip at arrival [m²], (n, dim, dim)
    hits: probability that the tip ends in the lesion, (n,)
    clearance: distance between the needle and the nearest margin of an obstacle [m], (n,)
    angles: angle between each path and the skin's normal [rad], (n,)
    reasons: reasons why each path is rejected; empty for an allowed path
    order: indices of the paths from the best to the worst, all allowed paths first, (n,)
    """

    entries: Floats
    directions: Floats
    tips: Floats
    lengths: Floats
    pushed: Floats
    means: Floats
    covs: Floats
    hits: Floats
    clearance: Floats
    angles: Floats
    reasons: tuple[tuple[str, ...], ...]
    order: NDArray[np.int64]

    @property
    def allowed(self) -> NDArray[np.bool_]:
        """Whether each path is allowed, (n,)."""
        return np.array([not reasons for reasons in self.reasons], dtype=bool)

    @property
    def best(self) -> int | None:
        """Index of the best path; None if all paths are rejected."""
        return int(self.order[0]) if self.allowed.any() else None


def compliance(network: MassSpringNetwork, target: str | TargetPoint) -> Floats:
    """Displacement of the target near rest due to a unit force on each of n free coordinates [m/N], (dim, n)."""
    K = stiffness_matrix(network, rest_shape(network))
    return np.asarray(np.linalg.solve(K, target_map(network, target).matrix.T).T)


def needle_displacement(
    network: MassSpringNetwork, C: Floats, needle: PlannedNeedle, tips: ArrayLike, entries: ArrayLike
) -> Floats:
    """Displacement of the target that each of n needles causes [m], (n, dim).

    C: result of `compliance` for the target [m/N]; tips, entries: ends of the needles [m], (n, dim)
    """
    to, from_ = np.asarray(tips, dtype=float), np.asarray(entries, dtype=float)
    along = to - from_
    lengths = np.linalg.norm(along, axis=1)
    back = 0.5 * (SHAFT[0] + 1.0)
    points = np.concatenate([to[:, None], to[:, None] - back[:, None] * along[:, None]], axis=1)
    rubbing = needle.friction_N_m * 0.5 * lengths[:, None] * SHAFT[1]
    most = np.concatenate([np.full((len(to), 1), needle.cutting_N), rubbing], axis=1)
    shared = np.einsum("nq,nqi->ni", most, node_weights(network, points, needle.reach_m))[:, network.free]
    directions = along / lengths[:, None]
    return np.einsum("dif,ni,nf->nd", C.reshape(len(C), len(network.free), -1), shared, directions)


def candidate_paths(
    network: MassSpringNetwork,
    target: str | TargetPoint,
    lesion: PlannedTarget,
    needle: PlannedNeedle,
    entries: Floats,
    n_aims: int = 5,
) -> tuple[Floats, Floats]:
    """Candidate paths from n entries, n_aims paths from each. Returns entries and tips [m], `(n * n_aims, dim)` each.

    entries: points where a needle may enter [m], (n, dim); n_aims: an odd number. From each entry, one path aims at the
        centre of the displaced target, the others at points up to 0.6 times the lesion's radius beside it.
    """
    C = compliance(network, target)
    from_ = np.repeat(entries, n_aims, axis=0)
    tips = np.tile(lesion.mean, (len(from_), 1))
    for _ in range(AIMING):
        tips = lesion.mean + needle_displacement(network, C, needle, tips, from_)
    along = tips - from_
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    steps = np.arange(n_aims) - n_aims // 2
    spread = np.tile(1.2 / max(1, n_aims - 1) * steps, len(entries))[:, None] * lesion.radius_m
    if network.dim == 2:
        return from_, tips + spread * np.stack([-along[:, 1], along[:, 0]], axis=1)
    least = np.eye(3)[np.abs(along).argmin(axis=1)]
    across = np.cross(along, least)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    turn = np.tile(np.linspace(0.0, np.pi, n_aims, endpoint=False), len(entries))[:, None]
    return from_, tips + spread * (np.cos(turn) * across + np.sin(turn) * np.cross(along, across))


def plan(
    network: MassSpringNetwork,
    target: str | TargetPoint,
    lesion: PlannedTarget,
    needle: PlannedNeedle,
    skin: Skin,
    obstacles: Sequence[Obstacle],
    *,
    entries: Floats,
    tips: Floats,
) -> Plan:
    """Evaluate and rank straight paths from entries to tips [m], (n, dim), such as those of `candidate_paths`.

    Raises ValueError if shapes differ or a path has no length. Raises NetworkError if there is no rest shape.
    """
    along = tips - entries
    lengths = np.linalg.norm(along, axis=1)
    if entries.shape != tips.shape or entries.shape[1:] != (network.dim,) or not (lengths > 0.0).all():
        raise ValueError(f"expected entries and other tips of shape (n, {network.dim}), found {entries.shape}")
    directions = along / lengths[:, None]
    pushed = needle_displacement(network, compliance(network, target), needle, tips, entries)
    means = lesion.mean + pushed
    # all forces have one common relative error, which changes the length of the displacement, not its direction
    covs = lesion.cov + needle.tip_sd_m**2 * np.eye(network.dim)
    covs = covs + needle.force_sd**2 * pushed[:, :, None] * pushed[:, None, :]
    hits = ball_hits(tips - means, covs, lesion.radius_m)
    room = clearances(entries, tips, obstacles, needle.radius_m)
    angles = np.arccos(np.clip(-directions @ skin.normal, -1.0, 1.0))
    low, high = np.minimum(skin.start, skin.end) - 1e-9, np.maximum(skin.start, skin.end) + 1e-9
    outside = np.any((entries < low) | (entries > high), axis=1).tolist()
    reasons = []
    for k in range(len(entries)):
        found = [one.name for one, own in zip(obstacles, room[k], strict=True) if own < 0.0]
        found += ["outside the entry"] if outside[k] else []
        found += ["too long"] if lengths[k] > skin.max_length_m else []
        found += ["too steep"] if angles[k] > skin.max_angle_rad else []
        reasons.append(tuple(found))
    clearance = room.min(axis=1) if len(obstacles) else np.full(len(entries), np.inf)
    rejected = np.array([bool(found) for found in reasons])
    order = np.lexsort((lengths, -clearance, -np.round(hits, SAME), rejected))
    return Plan(entries, directions, tips, lengths, pushed, means, covs, hits, clearance, angles, tuple(reasons), order)
