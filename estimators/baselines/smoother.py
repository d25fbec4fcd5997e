"""Fixed-interval smoother for comparison. Each estimate uses the marks of all frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.core.track import TissueFilter
from estimators.process.target import TargetPoint
from estimators.smoothing.smoother import TimedFix, fixed_interval
from estimators.tissue.estimate import MarkMeasurement, TargetEstimate
from estimators.tissue.settings import FilterSettings


class FixedIntervalSmoother:
    """Fixed-interval smoother. Its error is a lower limit for filters with the same model.

    fixes: direct measurements of the target, each with its time
    State: tissue, the filter of the forward pass.
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
        fixes: Sequence[TimedFix] = (),
    ) -> None:
        self._fixes = tuple(fixes)
        self.tissue = TissueFilter(
            network, target, marked, settings, uncertainty=uncertainty, n_calibration=n_calibration
        )

    def run(
        self,
        frames: Sequence[tuple[float, Sequence[MarkMeasurement]]],
        advance: Callable[[float], None] = lambda _share: None,
    ) -> Iterator[list[TargetEstimate]]:
        """Yield one list with the estimates of all frames.

        frames: (time [s], marks) in order; advance: called with the completed share of the frames
        """
        yield fixed_interval(self.tissue, frames, advance, fixes=self._fixes)
