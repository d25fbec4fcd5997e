"""Settings of advice, and the test whether advice may use an estimate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.tissue.estimate import Status, TargetEstimate


@dataclass(frozen=True, slots=True)
class AdviceSettings:
    """Settings of advice: thresholds, and the range of start times.

    go: least hit probability for GO; choice
    worth: least gain in hit probability that justifies waiting; choice
    horizon_s: time from now to the latest start of an insertion [s]; choice
    step_s: interval between start times [s]; choice
    stale_s: largest age of an estimate that may be used [s]; choice
    coasting_s: longest time without any mark for which an estimate may be used [s]; choice
    needle_s: largest age of the needle's last tracked pose that may be used [s]; choice: ten poses of a 10 Hz tracker
    overshot_m: if the tip is further than this beyond its planned depth, advice is to retract it [m]; choice
    abort: a needle that entered after a GO has to stop if its hit probability is below `abort` times `go`; choice
    abort_s: longest time from a GO to the needle's entry [s]; a GO that lasts as long ends ABORT; choice
    """

    go: float = 0.9
    worth: float = 0.05
    horizon_s: float = 2.0
    step_s: float = 0.1
    stale_s: float = 0.1
    coasting_s: float = 0.2
    needle_s: float = 1.0
    overshot_m: float = 1e-3
    abort: float = 0.5
    abort_s: float = 0.5

    def __post_init__(self) -> None:
        if not (0.0 < self.go <= 1.0 and 0.0 <= self.worth <= 1.0 and 0.0 <= self.abort <= 1.0):
            raise ValueError(f"advice go, worth, abort: expected 0 to 1, found {self.go}, {self.worth}, {self.abort}")
        for name in ("step_s", "stale_s", "needle_s"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"advice {name}: expected more than 0, found {getattr(self, name)}")
        for name in ("horizon_s", "coasting_s", "overshot_m", "abort_s"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise ValueError(f"advice {name}: expected 0 or more, found {getattr(self, name)}")


def health_fault(estimate: TargetEstimate, now_s: float, seen_s: float | None, settings: AdviceSettings) -> str | None:
    """The reason why advice must not use an estimate at a time [s]; None if advice may use it.

    seen_s: time of the last used mark [s]; None if no mark was used
    """
    age = now_s - estimate.time_s
    unseen = np.inf if seen_s is None else now_s - seen_s
    cov = estimate.cov
    faults = (
        (
            estimate.status in (Status.INITIALISING, Status.LOST, Status.DIVERGED),
            f"the estimate is {estimate.status}",
        ),
        (not age <= settings.stale_s, f"the estimate is {age:.2f} s old, more than {settings.stale_s:g} s"),
        (cov is None, "the estimate has no covariance"),
        (
            not np.isfinite(estimate.mean).all() or (cov is not None and not np.isfinite(cov).all()),
            "the estimate is not finite",
        ),
        (unseen > settings.coasting_s, f"no mark was seen for {unseen:.2f} s, more than {settings.coasting_s:g} s"),
        (estimate.model_only, "the marks contain almost no information on the target"),
    )
    return next((reason for holds, reason in faults if holds), None)
