"""Base class of the methods for comparison, which differ only in how they predict and update the state."""

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

    The initial mean is the state at rest. The initial covariance is that of a body on whose marked nodes short forces
    (pokes) have acted for `settings.lost_s`. The state is constant until the first mark. No mark is rejected.

    State: time_s, time of the estimate [s], None before the first frame; seen_s, time of the last used mark [s].
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
        """Predict the state over dt > 0 [s]."""

    @abstractmethod
    def _take(self, z: Floats, rows: NDArray[np.int64], R: Floats) -> float | None:
        """Update with `z = x[rows] + noise`, (m,); R: noise covariance, (m, m). Returns the NIS if it is computed."""

    @abstractmethod
    def _moments(self) -> tuple[Floats, Floats]:
        """Mean (n,) and covariance (n, n) of the first n entries of the state, at least of all free coordinates."""

    def _poked(self) -> float | None:
        """Probability that a short force acts now; None for a method that does not estimate it."""
        return None

    def run(
        self,
        frames: Sequence[tuple[float, Sequence[MarkMeasurement]]],
        advance: Callable[[float], None] = lambda _share: None,
    ) -> Iterator[list[TargetEstimate]]:
        """Predict and update, frame by frame. Yields a list with one estimate for each frame.

        frames: (time [s], marks) in order; advance: called with the completed share of the frames
        """
        for k, (time_s, marks) in enumerate(frames, start=1):
            self.predict(time_s)
            estimate = self.update(marks)
            advance(k / len(frames))
            yield [estimate]

    def predict(self, time_s: float) -> None:
        """Predict the state at an exposure time [s]; ValueError if it is not finite or before the last exposure."""
        if not np.isfinite(time_s) or (self.time_s is not None and time_s < self.time_s):
            raise ValueError(f"time_s: expected {self.time_s} or later, found {time_s}")
        if self.time_s is None:
            self._begin()
        elif self.seen_s is not None and time_s > self.time_s:
            # after a longer gap a filter resets its state, so further steps would only cost time
            self._advance(min(time_s - self.time_s, self.settings.forget_s))
        self.time_s = time_s

    def update(self, marks: Sequence[MarkMeasurement]) -> TargetEstimate:
        """Update with any number of marks at the present time, and estimate the target.

        Raises ValueError for a mark of a node that is not free, and for a mark of another dimension.
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
