"""Whether an estimate may guide: contradictions between marks and model, and errors that no mark shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from estimators import Doubt, DoubtSettings, MarkMeasurement, TargetEstimate, TissueFilter
from experiments.formats.scene.scene import Scene
from experiments.pipeline.integrity.budget import balance_of, error_budget, shares_words, unstated, variance_shares

MEANS = 2.0
"""Times over which forces are averaged that are seen before anything guides [1]."""

UNTESTED = "the forces on the marks were not seen long enough to test them"


class IntegrityMonitor:
    """Watches the estimates of a scene's filter, frame by frame in order of time.

    budget: sources of the target's error; unstated: what the filter's covariance lacks [m²], (dim, dim)
    State: the doubt; the balance of forces on the marks; tested_s, from when on that is tested [s], None before marks.
    """

    def __init__(self, scene: Scene, tissue: TissueFilter) -> None:
        self.budget = error_budget(scene, tissue)
        self.unstated = unstated(self.budget)
        # a hand that leads a body moves all marks together
        self.doubt = Doubt(DoubtSettings(together=0.0) if tissue.may_be_led else DoubtSettings())
        self._balance = balance_of(scene, tissue)
        self.tested_s: float | None = None

    def take(self, estimate: TargetEstimate, marks: Sequence[MarkMeasurement]) -> str | None:
        """Take in a frame's estimate and the marks that it used; why there is no guidance, None where there is.

        From the first marks on a body is watched for `MEANS` mean forces before anything guides: a spring that is cut
        shows in no innovation, and a poke may hide it from one mean.
        """
        self.doubt.update(estimate, self._balance.update(estimate.time_s, marks))
        if marks and self.tested_s is None:
            self.tested_s = estimate.time_s + MEANS * self._balance.mean_s
        is_tested = self.tested_s is not None and estimate.time_s >= self.tested_s
        return self.doubt.reason or (None if is_tested else UNTESTED)

    def widened(self, estimate: TargetEstimate) -> TargetEstimate:
        """The estimate with what the scene leaves unstated in its covariance."""
        return estimate if estimate.cov is None else replace(estimate, cov=estimate.cov + self.unstated)

    def largest_errors(self, estimate: TargetEstimate) -> str:
        """Which errors have most of the variance of the target of an estimate by the filter."""
        return shares_words(variance_shares(self.budget, estimate))

    def restart(self) -> None:
        """Forget the marks: the filter begins again."""
        self._balance.forget()
        self.tested_s = None

    def looked(self) -> None:
        """Somebody looked at tissue and marks: the doubt is over."""
        self.doubt.forget()
