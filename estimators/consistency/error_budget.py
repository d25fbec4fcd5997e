"""Error budget of a target at rest: covariances due to errors that do not show in the innovations.

An estimate that fits its marks (m) places the hidden nodes (h) where the model predicts them from the marks. An error s
of the marks' positions therefore moves the hidden nodes by `-Khh^-1 Khm s`. An unmodelled force g on the hidden nodes
moves them by `Khh^-1 g`. K is the stiffness at rest (static condensation).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dynamics import rest_shape, stiffness_matrix
from estimators.arrays import Floats
from estimators.core.track import TissueFilter
from estimators.process.process_model import LOOSE


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSource:
    """One source of error of the target, with the covariance that it causes.

    name: short name; cov: covariance of the target due to this source [m²], (dim, dim)
    considered: whether the filter's covariance includes this source; variance: trace of cov [m²]
    """

    name: str
    cov: Floats
    considered: bool
    variance: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "variance", float(np.trace(self.cov)))

    @classmethod
    def of(cls, name: str, directions: Floats, *, considered: bool) -> ErrorSource:
        """Error source of r independent errors; directions: target's shift by one sd of each error [m], (dim, r)."""
        return cls(name, directions @ directions.T, considered)


class StaticResponse:
    """Shift of the estimated target at rest due to errors. The estimate fits the marks of the given nodes exactly.

    rest: positions of all nodes at rest [m], (n_nodes, dim)
    """

    def __init__(self, tissue: TissueFilter, nodes: Sequence[str]) -> None:
        network, self._target = tissue.network, tissue.target
        self.rest = rest_shape(network)
        K = stiffness_matrix(network, self.rest)
        places = [network.coordinates(node) for node in nodes]
        self._m = np.array([i for place in places for i in range(place.start, place.stop)], dtype=np.int64)
        self._h = np.setdiff1d(np.arange(len(K)), self._m)
        self._hidden, self._coupling = K[np.ix_(self._h, self._h)], K[np.ix_(self._h, self._m)]

    def to_marks(self, shifts: Floats) -> Floats:
        """Shift of the target [m], (dim, r), due to each of r errors of the marks' positions [m], (m, r)."""
        return self._moved(shifts, -self._coupling @ shifts)

    def to_forces(self, forces: Floats) -> Floats:
        """Shift of the target [m], (dim, r), due to each of r forces on the free coordinates [N], (n_free dim, r)."""
        return self._moved(np.zeros((len(self._m), forces.shape[1])), forces[self._h])

    def _moved(self, marked: Floats, forces: Floats) -> Floats:
        shifts = np.zeros((len(self._m) + len(self._h), forces.shape[1]))
        shifts[self._m] = marked
        # least squares: if no spring resists a rotation about the marks, the hidden nodes do not rotate
        shifts[self._h] = np.linalg.lstsq(self._hidden, forces, rcond=LOOSE)[0]
        return self._target.linear(shifts)
