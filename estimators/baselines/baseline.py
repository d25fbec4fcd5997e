"""Common part of the compared methods: they differ only in how they predict and update the state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from dynamics import MassSpringNetwork, pack, rest_shape
from estimators.arrays import Floats
from estimators.process.process_model import TissueModel, accumulated_noise
from estimators.process.target import TargetPoint, target_map
from estimators.tissue.estimate import MarkMeasurement, Status, TargetEstimate
from estimators.tissue.settings import FilterSettings


class Baseline(ABC):
    """Base class of the methods for comparison; the recommended filter is `TissueFilter`.

    It starts at rest, with the covariance that pokes cause in `settings.lost_s`, and stays at rest until the first
    marks. Marks are not gated.

    State: time_s of the estimate, None before the first frame; seen_s, time of the last mark used.
    """

    def __init__(
        self,
        network: MassSpringNetwork,
        target: str | TargetPoint,
        marked: Sequence[str],
        settings: FilterSettings | None = None,
    ) -> None:
        self.settings = FilterSettings() if settings is None else settings
        self.model = TissueModel(network, marked)
        self.time_s: float | None = None
        self.seen_s: float | None = None
        self.target = target_map(network, target)

    @abstractmethod
    def _start(self, mean: Floats, cov: Floats) -> None:
        """Set the state: mean (dim_x,), cov (dim_x, dim_x)."""

    @abstractmethod
    def _advance(self, dt: float) -> None:
        """Predict the state by dt [s], more than 0."""

    @abstractmethod
    def _take(self, z: Floats, rows: NDArray[np.int64], R: Floats) -> float | None:
        """Update with z = x[rows] + noise of covariance R, (m,), (m, m); returns the NIS, or None without a NIS."""

    @abstractmethod
    def _moments(self) -> tuple[Floats, Floats]:
        """Mean and covariance of the state, (n,), (n, n), which begins with the free coordinates."""

    def _poked(self) -> float | None:
        """Probability that an external force acts; None for a method with a single mode."""
        return None

    def run(
        self,
        frames: Sequence[tuple[float, Sequence[MarkMeasurement]]],
        advance: Callable[[float], None] = lambda _share: None,
    ) -> Iterator[list[TargetEstimate]]:
        """Estimates for frames, (time [s], marks) in order, one by one: for each, predict and update.

        advance: called with the completed share of the frames.
        """
        for k, (time_s, marks) in enumerate(frames, start=1):
            self.predict(time_s)
            estimate = self.update(marks)
            advance(k / len(frames))
            yield [estimate]

    def predict(self, time_s: float) -> None:
        """Predict to this exposure time [s]; raises ValueError for an earlier time and one that is not finite."""
        if not np.isfinite(time_s) or (self.time_s is not None and time_s < self.time_s):
            raise ValueError(f"time_s: expected {self.time_s} or later, found {time_s}")
        if self.time_s is None:
            self._begin()
        elif self.seen_s is not None and time_s > self.time_s:
            # a filter forgets its state in a longer gap: steps through days would only cost time
            self._advance(min(time_s - self.time_s, self.settings.forget_s))
        self.time_s = time_s

    def update(self, marks: Sequence[MarkMeasurement]) -> TargetEstimate:
        """Update with any number of marks at the present time, and estimate the target.

        Raises ValueError for a mark that is not on a free node or has another dimension.
        """
        if self.time_s is None:
            raise ValueError("update: expected predict(time_s) first, found no time")
        nis = None
        if marks:
            nis = self._take(*self._stacked(marks))
            self.seen_s = self.time_s
        mean, cov = self._moments()
        mean, cov = self.target.position(mean), self.target.cov(cov)
        return TargetEstimate(self.time_s, mean, cov, self._status(self.time_s), len(marks), nis, self._poked())

    def _begin(self) -> None:
        network, shape = self.model.network, rest_shape(self.model.network)
        mean = np.zeros(self.model.dim_x)
        mean[: network.n_state] = pack(shape[network.free], np.zeros_like(shape[network.free]))
        poked = self.model.linearised(shape, self.settings.poked)
        self._start(mean, accumulated_noise(*poked, self.settings.lost_s))

    def _stacked(self, marks: Sequence[MarkMeasurement]) -> tuple[Floats, NDArray[np.int64], Floats]:
        network = self.model.network
        for mark in marks:
            if len(mark.position) != network.dim:
                raise ValueError(
                    f"mark {mark.node} position: expected shape {(network.dim,)}, found {mark.position.shape}"
                )
        places = [network.coordinates(mark.node) for mark in marks]
        rows = np.concatenate([np.arange(place.start, place.stop) for place in places])
        return np.concatenate([mark.position for mark in marks]), rows, block_diag(*(mark.total_cov for mark in marks))

    def _status(self, time_s: float) -> Status:
        if self.seen_s is None:
            return Status.INITIALISING
        if time_s == self.seen_s:
            return Status.TRACKING
        return Status.COASTING if time_s - self.seen_s <= self.settings.lost_s else Status.LOST
