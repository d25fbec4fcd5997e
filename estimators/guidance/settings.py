"""Thresholds between the kinds of advice, and when an estimate is not fit to advise on a needle at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.tissue.estimate import Status, TargetEstimate


@dataclass(frozen=True, slots=True)
class AdviceSettings:
    """Thresholds between the kinds of advice, and how far ahead insertions are tried.

    go: probability of a hit from which on to insert; choice
    worth: by how much more probable a later hit must be to be waited for; choice
    horizon_s: insertions are tried that begin up to so much later [s]; choice
    step_s: between two starts that are tried [s]; choice
    stale_s: age from which an estimate gives no guidance [s]; choice
    coasting_s: time without any mark from which an estimate gives no guidance [s]; choice
    overshot_m: depth beyond the aim from which a tip has to be drawn back [m]; choice
    abort: a needle that is inside and was given GO has to stop where a hit is less than this part of go probable;
        choice
    abort_s: such a stop stays until there has been guidance for so long [s]; choice
    """

    go: float = 0.9
    worth: float = 0.05
    horizon_s: float = 2.0
    step_s: float = 0.1
    stale_s: float = 0.1
    coasting_s: float = 0.2
    overshot_m: float = 1e-3
    abort: float = 0.5
    abort_s: float = 0.5

    def __post_init__(self) -> None:
        if not (0.0 < self.go <= 1.0 and 0.0 <= self.worth <= 1.0 and 0.0 <= self.abort <= 1.0):
            raise ValueError(f"advice go, worth, abort: expected 0 to 1, found {self.go}, {self.worth}, {self.abort}")
        for name in ("step_s", "stale_s"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"advice {name}: expected more than 0, found {getattr(self, name)}")
        for name in ("horizon_s", "coasting_s", "overshot_m", "abort_s"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise ValueError(f"advice {name}: expected 0 or more, found {getattr(self, name)}")


def health_fault(estimate: TargetEstimate, now_s: float, seen_s: float | None, settings: AdviceSettings) -> str | None:
    """Reason in words why an estimate gives no guidance at this time [s]; None where it does.

    seen_s: time of the last mark used [s], None if never
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
        (estimate.model_only, "the marks tell next to nothing of the target: the model alone speaks"),
    )
    return next((reason for holds, reason in faults if holds), None)
