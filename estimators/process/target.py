"""The target as a linear function of the state: weighted nodes and an offset from them."""

from __future__ import annotations

from dataclasses import dataclass
from math import isclose

import numpy as np

from dynamics import MassSpringNetwork, reaches
from estimators.arrays import Floats


@dataclass(frozen=True, slots=True)
class TargetPoint:
    """A point of the tissue, position = sum_i weights_i x_i + offset; a node where nothing else is given.

    nodes: names, n of them; weights: of their positions, (n,), that sum to 1; offset_m: fixed in direction [m], (dim,),
    none where it is empty
    """

    nodes: tuple[str, ...]
    weights: tuple[float, ...] = (1.0,)
    offset_m: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not self.nodes or len(self.nodes) != len(self.weights) or len(set(self.nodes)) != len(self.nodes):
            raise ValueError(f"target: expected different nodes, a weight each, found {self.nodes}, {self.weights}")
        if not isclose(sum(self.weights), 1.0, abs_tol=1e-9):
            raise ValueError(f"target weights: expected a sum of 1, found {self.weights}")


@dataclass(frozen=True, slots=True, eq=False)
class TargetMap:
    """Position of a target from a state: matrix @ free coordinates + constant.

    point: what was asked for; matrix [1], (dim, n_free dim); constant [m], (dim,): the offset and the anchors' share
    reached_m2: variance of each coordinate of a target of which nothing is known but that its nodes are within reach of
        their anchors, or, of a body without, of its farthest node [m²]; held: whether the body has anchors
    Every state handed in begins with the free coordinates and may go on with anything, as a filter's does.
    """

    point: TargetPoint
    matrix: Floats
    constant: Floats
    reached_m2: float
    held: bool

    @property
    def anywhere_m2(self) -> float:
        """The largest variance of a coordinate that can be [m²]: infinite of a body without anchors, which may fly."""
        return self.reached_m2 if self.held else np.inf

    def position(self, states: Floats) -> Floats:
        """Where the target is [m], (..., dim), for states (..., n)."""
        return np.asarray(states[..., : self.matrix.shape[1]] @ self.matrix.T + self.constant)

    def linear(self, columns: Floats) -> Floats:
        """How the target moves with each column of changes of the state, (..., n, r): (..., dim, r)."""
        return np.asarray(self.matrix @ columns[..., : self.matrix.shape[1], :])

    def cov(self, covs: Floats) -> Floats:
        """Covariance of the target [m²], (..., dim, dim), for covariances of the state (..., n, n)."""
        n = self.matrix.shape[1]
        return np.asarray(self.matrix @ covs[..., :n, :n] @ self.matrix.T)

    def within_reach(self, covs: Floats) -> Floats:
        """Covariances of the target [m²], (..., dim, dim), no larger in any direction than if it were anywhere.

        Linear motion knows nothing of how far links let a node go.
        """
        if not (np.trace(covs, axis1=-2, axis2=-1) > self.anywhere_m2).any():
            return covs
        values, vectors = np.linalg.eigh(covs)
        return np.asarray((vectors * np.minimum(values, self.anywhere_m2)[..., None, :]) @ vectors.swapaxes(-1, -2))


def target_map(network: MassSpringNetwork, target: str | TargetPoint) -> TargetMap:
    """The map of a node by its name or of a point; raises NetworkError for names that are not the network's.

    Raises ValueError for an offset of another dimension and for a point that no free node moves.
    """
    point = TargetPoint((target,)) if isinstance(target, str) else target
    offset = np.array(point.offset_m or np.zeros(network.dim), dtype=float)
    if offset.shape != (network.dim,) or not np.isfinite(offset).all():
        raise ValueError(f"target offset_m: expected {network.dim} finite numbers, found {point.offset_m}")
    matrix = np.zeros((network.dim, network.n_state // 2))
    fixed = {network.names[i] for i in np.flatnonzero(network.fixed)}
    for node, weight in zip(point.nodes, point.weights, strict=True):
        if node in fixed and len(point.nodes) > 1:
            offset += weight * network.positions[network.index(node)]
        else:
            matrix[:, network.coordinates(node)] = weight * np.eye(network.dim)
    if not matrix.any():
        raise ValueError(f"target: expected a weight on a free node, found {point.nodes}, {point.weights}")
    weights = matrix[0].reshape(-1, network.dim)[:, 0]
    reach = float(np.abs(weights) @ reaches(network)[network.free])
    return TargetMap(point, matrix, offset, reach**2 / (network.dim + 2), bool(fixed))
