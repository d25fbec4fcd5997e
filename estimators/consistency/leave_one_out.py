"""Consistency check without ground truth: each mark is predicted by a filter that does not use it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.arrays import Floats
from estimators.core.track import TissueFilter
from estimators.filters.adaptation import VarianceScale
from estimators.process.target import TargetPoint
from estimators.tissue.estimate import MarkMeasurement, Status, TargetEstimate
from estimators.tissue.settings import FilterSettings


@dataclass(frozen=True, slots=True, eq=False)
class LeaveOneOutCheck:
    """Prediction of one mark in one frame by a filter that does not use this mark.

    error: measured minus predicted position [m], (dim,); nees: squared error, normalised by the error's covariance
    """

    error: Floats
    nees: float


class LeaveOneOut:
    """Filter of the target and, for each marked node, a filter that predicts this node's mark without using it.

    If the errors of these predictions exceed their covariance, the model is wrong, also at the target. A factor on the
    covariance of the predictions is therefore estimated by maximum likelihood. The covariance of the target is
    multiplied by the same factor, which is at least 1.

    State: tissue, the filter of the target; without, the filters that predict marks, by node; scale, the factor on the
    covariance; checks, the checks of the last frame, by node.
    """

    def __init__(
        self,
        network: MassSpringNetwork,
        target: str | TargetPoint,
        marked: Sequence[str],
        settings: FilterSettings | None = None,
        *,
        uncertainty: ParameterUncertainty | None = None,
        n_calibration: int = 0,
    ) -> None:
        if len(marked) < 2:
            raise ValueError(f"marked: expected two or more nodes, found {len(marked)}")
        self.tissue, *others = (
            TissueFilter(network, node, marked, settings, uncertainty=uncertainty, n_calibration=n_calibration)
            for node in (target, *marked)
        )
        self.without = dict(zip(marked, others, strict=True))
        self.checks: Mapping[str, LeaveOneOutCheck] = {}
        self._scales = VarianceScale((1.0, np.inf))
        self._time_s: float | None = None

    @property
    def scale(self) -> float:
        """Factor of 1 or more by which the target's covariance is multiplied."""
        return self._scales.scale

    def predict(self, time_s: float) -> None:
        """Predict all filters at an exposure time [s]. Raises ValueError like `TissueFilter.predict`."""
        self.tissue.predict(time_s)
        for other in self.without.values():
            other.predict(time_s)

    def update(self, marks: Sequence[MarkMeasurement]) -> TargetEstimate:
        """Update all filters with the marks, check each mark, and estimate the target."""
        return self.checked(self.tissue.update(marks), marks)

    def checked(self, estimate: TargetEstimate, marks: Sequence[MarkMeasurement]) -> TargetEstimate:
        """Check marks that the target's filter has already used, and scale the covariance of the estimate.

        estimate: result of the target's filter for these marks. Marks that the target's filter rejected are omitted.
        """
        checks = {}
        dt = 0.0 if self._time_s is None else estimate.time_s - self._time_s
        self._time_s = estimate.time_s
        for node, other in self.without.items():
            predicted = other.update([mark for mark in marks if mark.node != node])
            seen = [mark for mark in marks if mark.node == node]
            if not seen or predicted.cov is None or predicted.status is not Status.TRACKING:
                continue
            if node not in estimate.information_share:  # an outlier does not test the model
                continue
            error = seen[0].position - predicted.mean
            own = other.level.noise**2 * seen[0].cov + _with_calibration(other, seen[0])
            checks[node] = LeaveOneOutCheck(error, float(error @ np.linalg.solve(predicted.cov + own, error)))
            self._scales.learn(error, predicted.cov, own, dt / len(self.without))
        self.checks = checks
        return replace(estimate, cov=None if estimate.cov is None else self.scale * estimate.cov)


def _with_calibration(other: TissueFilter, mark: MarkMeasurement) -> Floats:
    """Covariance that calibration errors add to a mark's deviation from the prediction by `other` [m²], (dim, dim).

    Calibration errors affect the filter's prediction with the sensitivity C, and the mark with the sensitivity F. The
    filter's covariance already contains C C'. The errors therefore add `(C + F)(C + F)' - C C'`.
    """
    if mark.shared is None:
        return np.zeros_like(mark.cov)
    added = mark.shared @ mark.shared.T
    if other.n_calibration:
        columns = other.by_calibration
        added += columns @ mark.shared.T + mark.shared @ columns.T
    return added
