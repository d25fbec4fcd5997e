"""Target as a linear function of the state: a weighted sum of node positions plus an offset."""

from __future__ import annotations

from dataclasses import dataclass
from math import isclose

import numpy as np

from dynamics import MassSpringNetwork
from estimators.arrays import Floats


@dataclass(frozen=True, slots=True)
class TargetPoint:
    """A point of the tissue: the weighted sum of node positions, plus an offset.

    nodes: names of n nodes; weights: weight of each node, (n,), with sum 1. A point with one node needs no weight.
    offset_m: constant offset [m], (dim,), zero if empty
    sd_m: standard deviation of the error of `offset_m` on each axis [m]
    """

    nodes: tuple[str, ...]
    weights: tuple[float, ...] = (1.0,)
    offset_m: tuple[float, ...] = ()
    sd_m: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.sd_m < np.inf:
            raise ValueError(f"target sd_m: expected 0 or more, finite, found {self.sd_m}")
        if not self.nodes or len(self.nodes) != len(self.weights) or len(set(self.nodes)) != len(self.nodes):
            raise ValueError(f"target: expected different nodes, one weight each, found {self.nodes}, {self.weights}")
        if not isclose(sum(self.weights), 1.0, abs_tol=1e-9):
            raise ValueError(f"target weights: expected a sum of 1, found {self.weights}")


@dataclass(frozen=True, slots=True, eq=False)
class TargetMap:
    """Map from a state to the position of a target: `matrix @ (positions of the free nodes) + constant`.

    point: the target; matrix: weights of the free nodes [1], (dim, n_free dim)
    constant: offset plus the weighted positions of fixed nodes [m], (dim,)
    The first entries of a state are the positions of the free nodes.
    """

    point: TargetPoint
    matrix: Floats
    constant: Floats

    def position(self, states: Floats) -> Floats:
        """Position of the target [m], (..., dim), in states (..., n)."""
        return np.asarray(states[..., : self.matrix.shape[1]] @ self.matrix.T + self.constant)

    def linear(self, columns: Floats) -> Floats:
        """Change of the target's position, (..., dim, r), due to changes of the state, (..., n, r)."""
        return np.asarray(self.matrix @ columns[..., : self.matrix.shape[1], :])

    def cov(self, covs: Floats) -> Floats:
        """Covariance of the target [m²], (..., dim, dim), from covariances of the state (..., n, n)."""
        n = self.matrix.shape[1]
        return np.asarray(self.matrix @ covs[..., :n, :n] @ self.matrix.T)


def target_map(network: MassSpringNetwork, target: str | TargetPoint) -> TargetMap:
    """Map from a state to the position of a target, which is a point of the tissue or the name of a node.

    Raises NetworkError for unknown nodes. Raises ValueError if no free node moves the target, or for an invalid offset.
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
    return TargetMap(point, matrix, offset)
