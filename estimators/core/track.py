"""The target of a tissue from its marks, by the unified filter: gate, start and status."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from dynamics import MassSpringNetwork
from estimators.arrays import Floats
from estimators.core.discrepancy import Discrepancy, LevelPosterior
from estimators.core.disturbances import Disturbances
from estimators.core.filter import HypothesisFilter
from estimators.core.marks import Places
from estimators.core.tissue import TissueProcess
from estimators.process.target import TargetMap, TargetPoint, target_map
from estimators.tissue.estimate import MarkMeasurement, Status, TargetEstimate

GATE = 1e-5
"""Probability of a mark as far away as it was seen, by the hypothesis nearest to it, below which it is rejected [1];
choice."""

REFUTED_S = 0.25
"""After so long without a mark that passes the gate, while some are seen, the filter begins again [s]; choice."""

SETTLED_S, LOST_S, FORGET_S = 0.5, 1.0, 5.0
"""An estimate is INITIALISING for so long; without marks the target is LOST after so long, and the filter begins again
after so long [s]; choice."""


class UnifiedFilter:
    """Where the target is, from marks on the tissue.

    The same filter for every body: no setting depends on its stiffness or size but by `Disturbances.raised`.

    Parameters
    ----------
    network : MassSpringNetwork
    target : str or TargetPoint
    marked : sequence of str
        Nodes whose marks are measured.
    led : sequence of str
        Those of them that are led all the time.
    disturbances, discrepancy
        Priors of unknown forces, and of what the model leaves out.

    Attributes
    ----------
    time_s : float or None
        Of the state; None before the first frame.
    """

    def __init__(
        self,
        network: MassSpringNetwork,
        target: str | TargetPoint,
        marked: Sequence[str],
        *,
        led: Sequence[str] = (),
        disturbances: Disturbances | None = None,
        discrepancy: Discrepancy | None = None,
    ) -> None:
        self.process = TissueProcess(network, marked, led=led, disturbances=disturbances, discrepancy=discrepancy)
        self.target = target_map(network, target)
        self._maps = {name: self.process.node(name) for name in (network.names[i] for i in network.free)}
        self._near = _withheld_together(network, marked, self.target.point)
        self._begin()
        self.time_s: float | None = None

    def _begin(self) -> None:
        self.level = LevelPosterior(self.process.discrepancy)
        self.filter = HypothesisFilter(self.process, self.level, self._groups)
        self._began_s: float | None = None
        self._seen_s = self._refuted_s = -np.inf

    def run(
        self,
        frames: Sequence[tuple[float, Sequence[MarkMeasurement]]],
        advance: Callable[[float], None] = lambda _share: None,
    ) -> Iterator[list[TargetEstimate]]:
        """Estimates of frames, (time [s], marks) in order, one at a time; advance: gets the share done."""
        for k, (time_s, marks) in enumerate(frames, start=1):
            self.predict(time_s)
            estimate = self.update(marks)
            advance(k / len(frames))
            yield [estimate]

    def predict(self, time_s: float) -> None:
        """Move the state to this exposure time [s]; raises ValueError where time goes back or is not finite."""
        if not np.isfinite(time_s) or (self.time_s is not None and time_s < self.time_s):
            raise ValueError(f"time_s: expected {self.time_s} or later, found {time_s}")
        if self.time_s is not None and time_s > self.time_s and self._began_s is not None:
            if time_s - self.time_s > FORGET_S:
                self._begin()
            else:
                self.filter.predict(time_s - self.time_s)
        self.time_s = time_s

    def update(self, marks: Sequence[MarkMeasurement]) -> TargetEstimate:
        """Take in the marks seen at the state's time, any number of them, and estimate the target.

        Raises ValueError for a mark that is not on a free node or has another dimension.
        """
        if self.time_s is None:
            raise ValueError("update: expected predict(time_s) before, found no time")
        for mark in marks:
            if mark.node not in self._maps or len(mark.position) != self.process.network.dim:
                raise ValueError(f"mark {mark.node}: expected a free node and {self.process.network.dim} coordinates")
        kept = self._gated(marks)
        nis = None
        if kept:
            nis = self.filter.update([Places(kept, self._maps)])
            self._began_s = self.time_s if self._began_s is None else self._began_s
            self._seen_s, self._refuted_s = self.time_s, -np.inf
        mean, cov = self.place_of(self.target)
        return TargetEstimate(self.time_s, mean, cov, self._status(), len(kept), nis, self._poked())

    def place_of(self, point: TargetMap) -> tuple[Floats, Floats]:
        """Mean (dim,) [m] and covariance (dim, dim) [m²] of a point of the tissue."""
        mean, cov = self.filter.moments(self.process.places(point.matrix))
        return mean + point.constant, cov + point.point.sd_m**2 * np.eye(len(mean))

    def _gated(self, marks: Sequence[MarkMeasurement]) -> list[MarkMeasurement]:
        """Marks that some hypothesis explains; all of them at a start."""
        if not marks or self._began_s is None or self.time_s is None:
            return list(marks)
        places = Places(marks, self._maps)
        found = self.filter.innovations([places])
        bound = chi2.isf(GATE, self.process.network.dim)
        kept = []
        for mark, rows in zip(marks, places.blocks, strict=True):
            y, S = found.y[:, rows], found.S[:, rows, rows]
            if float(np.einsum("kd,kd->k", y, np.linalg.solve(S, y[..., None])[..., 0]).min()) <= bound:
                kept.append(mark)
        if kept:
            return kept
        self._refuted_s = self.time_s if self._refuted_s == -np.inf else self._refuted_s
        if self.time_s - self._refuted_s < REFUTED_S:
            return []
        self._begin()
        return list(marks)

    def _status(self) -> Status:
        if self._began_s is None or self.time_s is None:
            return Status.INITIALISING
        unseen_s = self.time_s - self._seen_s
        if unseen_s > LOST_S:
            return Status.LOST
        if self._refuted_s > -np.inf:
            return Status.DIVERGED
        if self.time_s - self._began_s < SETTLED_S:
            return Status.INITIALISING
        return Status.TRACKING if unseen_s == 0.0 else Status.COASTING

    def _poked(self) -> float:
        """Probability that a short force acts."""
        by_mode = self.filter.weights.reshape(-1, 3)
        return float(by_mode[:, 1:].sum())

    def _groups(self, names: Sequence[str], blocks: Sequence[slice]) -> Sequence[NDArray[np.int64]]:
        rows = {name: np.arange(block.start, block.stop) for name, block in zip(names, blocks, strict=True)}
        return [
            np.array([rows[name], *(rows[other] for other in self._near.get(name, ()) if other in rows)])
            for name in names
        ]


def _withheld_together(
    network: MassSpringNetwork, marked: Sequence[str], point: TargetPoint
) -> dict[str, tuple[str, ...]]:
    """For each mark the others that are nearer to it than the target is to any mark: it is hidden among none such."""
    places = {name: network.positions[network.index(name)] for name in marked}
    where = np.average([network.positions[network.index(name)] for name in point.nodes], axis=0, weights=point.weights)
    reach = min(float(np.linalg.norm(place - where)) for name, place in places.items())
    return {
        name: tuple(
            other for other, there in places.items() if other != name and np.linalg.norm(there - place) < 0.99 * reach
        )
        for name, place in places.items()
    }
