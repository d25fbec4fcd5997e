"""The target as a linear function of the state: a weighted sum of nodes plus an offset."""

from __future__ import annotations

from dataclasses import dataclass
from math import isclose

import numpy as np

from dynamics import MassSpringNetwork, reaches
from estimators.arrays import Floats


@dataclass(frozen=True, slots=True)
class TargetPoint:
    """A point of the tissue, position = sum_i weights_i x_i + offset; by default a node.

    nodes: n names; weights: their weights, (n,), with sum 1; offset_m: offset of constant direction [m], (dim,),
    zero if empty; sd_m: uncertainty of the offset, one standard deviation for each axis [m]
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
    """Map from a state to the position of a target: matrix @ free coordinates + constant + error of the offset.

    point: the mapped point; matrix [1], (dim, n_free dim); constant [m], (dim,): offset plus the anchors' share
    error_rows: states that estimate the error of the offset; None where the offset is exact
    reached_m2: variance of each coordinate [m²] if only the largest distance of the target's nodes from their anchors
        is known (without anchors: from the farthest node); held: whether anchors hold the body
    Every state begins with the free coordinates; any other states may follow. A state of the network alone contains no
    error of the offset.
    """

    point: TargetPoint
    matrix: Floats
    constant: Floats
    reached_m2: float
    held: bool
    error_rows: slice | None = None

    @property
    def anywhere_m2(self) -> float:
        """Largest possible variance of a coordinate [m²]; infinite for a body without anchors."""
        return self.reached_m2 if self.held else np.inf

    def position(self, states: Floats) -> Floats:
        """Position of the target [m], (..., dim), for states (..., n)."""
        place = states[..., : self.matrix.shape[1]] @ self.matrix.T + self.constant
        rows = self._rows_in(states.shape[-1])
        return np.asarray(place if rows is None else place + states[..., rows])

    def linear(self, columns: Floats) -> Floats:
        """Change of the target with each column of changes of the state, (..., n, r): (..., dim, r)."""
        moved = self.matrix @ columns[..., : self.matrix.shape[1], :]
        rows = self._rows_in(columns.shape[-2])
        return np.asarray(moved if rows is None else moved + columns[..., rows, :])

    def cov(self, covs: Floats) -> Floats:
        """Covariance of the target [m²], (..., dim, dim), for covariances of the state (..., n, n)."""
        if self._rows_in(covs.shape[-1]) is None:
            n = self.matrix.shape[1]
            return np.asarray(self.matrix @ covs[..., :n, :n] @ self.matrix.T)
        H = self.over(covs.shape[-1])
        return np.asarray(H @ covs @ H.T)

    def over(self, dim_x: int) -> Floats:
        """The map's matrix over a whole state [1], (dim, dim_x)."""
        H = np.zeros((len(self.matrix), dim_x))
        H[:, : self.matrix.shape[1]] = self.matrix
        rows = self._rows_in(dim_x)
        if rows is not None:
            H[:, rows] = np.eye(len(H))
        return H

    def tissue_m2(self, cov: Floats, P: Floats) -> float:
        """Trace of the target's covariance [m²], (dim, dim), minus the variance of its offset in P, (dim_x, dim_x)."""
        own = 0.0 if self.error_rows is None else float(np.trace(P[self.error_rows, self.error_rows]))
        return float(np.trace(cov)) - own

    def _rows_in(self, n: int) -> slice | None:
        return self.error_rows if self.error_rows is not None and n >= self.error_rows.stop else None

    def within_reach(self, covs: Floats) -> Floats:
        """Covariances of the target [m²], (..., dim, dim), limited to `anywhere_m2` in each direction.

        The limit is needed because a linear motion ignores how far links let a node move.
        """
        if not (np.trace(covs, axis1=-2, axis2=-1) > self.anywhere_m2).any():
            return covs
        values, vectors = np.linalg.eigh(covs)
        return np.asarray((vectors * np.minimum(values, self.anywhere_m2)[..., None, :]) @ vectors.swapaxes(-1, -2))


def target_map(network: MassSpringNetwork, target: str | TargetPoint, error_rows: slice | None = None) -> TargetMap:
    """The map from a state to a target, a node's name or a point; raises NetworkError for unknown names.

    error_rows: states that estimate the error of its offset; None or empty: the offset is exact
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
    if error_rows is None or error_rows.start == error_rows.stop:
        return TargetMap(point, matrix, offset, reach**2 / (network.dim + 2), network.is_held)
    reached_m2 = reach**2 / (network.dim + 2) + point.sd_m**2
    return TargetMap(point, matrix, offset, reached_m2, network.is_held, error_rows)
