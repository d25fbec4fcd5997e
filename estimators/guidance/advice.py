"""Advice on the needle: insert, wait, realign, stop, or no guidance because the estimate is not healthy.

For each frame, `estimators.guidance.path` predicts the target's path. The path determines the needle's arrival time,
the mean and covariance of the target at that time, and the hit probabilities of insertions now and later. `RULES` turn
these numbers into advice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

import numpy as np

from estimators.arrays import Floats
from estimators.core.track import TissueFilter
from estimators.guidance.kernels import insert_each
from estimators.guidance.lesion import Lesion
from estimators.guidance.needle import Insertion, Needle
from estimators.guidance.path import MOST_S, TargetPath, kept_path, time_to
from estimators.guidance.settings import AdviceSettings, health_fault
from estimators.tissue.estimate import TargetEstimate

PATH_STEP_S = 1.0 / 30.0
"""Interval between the times of a predicted path [s]; numerical: half or twice this interval changes the mean hit
probability by less than 0.4 %. For oscillations of 10 mm at 3 Hz, the error of cubic interpolation is below 0.1 mm."""


class Advice(StrEnum):
    """Advice for the needle now."""

    GO = "GO"
    """Insert: a hit is probable, and waiting hardly increases the probability."""
    WAIT = "WAIT"
    """Do not insert yet: a later start is better, or no hit is probable enough."""
    REALIGN = "REALIGN"
    """Turn the needle towards the aim, or retract it."""
    NO_GUIDANCE = "NO_GUIDANCE"
    """No advice, because the estimate is not healthy."""
    ABORT = "ABORT"
    """Stop: the needle is inside, and the reason for inserting it no longer holds. Only `AbortWatch` gives ABORT."""


@dataclass(frozen=True, slots=True, eq=False)
class Outlook:
    """Predicted results of k insertions along the present direction; starts_s: start times [s], (k,).

    arrivals_s: times at which the part of the needle that has to hit is at the target's depth [s], (k,); inf if the
        predicted path of the target ends earlier
    probabilities: hit probabilities [1], (k,); 0 if the needle does not arrive
    """

    starts_s: Floats
    arrivals_s: Floats
    probabilities: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Guidance:
    """Advice at one time, and the numbers from which it follows.

    If the estimate is not healthy, all fields except `advice` and `reason` are None. If a needle that is inserted now
    would arrive after the last time of the predicted path, only `advice`, `reason` and `outlook` are not None.

    advice, reason: the advice, and its reason in words
    arrival_s: for an insertion now, time at which the part of the needle that has to hit reaches the target [s]
    probability: hit probability of an insertion now along the present direction
    aim: predicted position of the target at arrival_s [m], (dim,)
    cov: covariance of the target at arrival_s [m²], (dim, dim)
    lateral_m: distance of the aim from the needle's line [m]
    depth_m: distance by which the tip has to advance or, if negative, to retract [m]
    turn_rad: angle of a turn of the needle about its entry, towards the aim [rad]
    turned_axis, turned_probability: direction after this turn, (dim,), and hit probability along this direction
    best_in_s: time from now until the best start of an insertion along the present direction [s]
    best_probability: hit probability of an insertion at the best start
    outlook: results for all start times; None if the estimate is not healthy
    """

    advice: Advice
    reason: str
    arrival_s: float | None = None
    probability: float | None = None
    aim: Floats | None = None
    cov: Floats | None = None
    lateral_m: float | None = None
    depth_m: float | None = None
    turn_rad: float | None = None
    turned_axis: Floats | None = None
    turned_probability: float | None = None
    best_in_s: float | None = None
    best_probability: float | None = None
    outlook: Outlook | None = None


@dataclass(frozen=True, slots=True)
class Prospect:
    """Input of the rules of advice: predicted results of insertions now, later, and after a turn.

    probability: hit probability of an insertion now along the present direction; 0 if the needle never arrives
    reach_s: duration of the target's predicted path [s]; arrives: whether a needle that starts now arrives in this time
    best_in_s, best_probability: time from now until the best start [s], and hit probability of an insertion then
    turn_rad: angle by which the needle has to turn about its entry to point at the predicted target [rad]
    turned_probability: hit probability of an insertion now, if the needle first turns by turn_rad
    depth_m: distance by which the tip has to advance or, if negative, to retract [m]
    behind: whether the target lies behind the entry, so that the needle cannot reach it along the present direction
    target_sd_m: largest standard deviation of the target in any direction at arrival [m]
    tip_sd_m: largest standard deviation of the tip in any direction [m]
    """

    probability: float
    arrives: bool
    reach_s: float
    best_in_s: float
    best_probability: float
    turn_rad: float = 0.0
    turned_probability: float = 0.0
    depth_m: float = 0.0
    behind: bool = False
    target_sd_m: float = 0.0
    tip_sd_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule. If the condition `holds` is true, the rule gives its advice, and in words the reason for this advice."""

    advice: Advice
    holds: Callable[[Prospect, AdviceSettings], bool]
    reason: Callable[[Prospect], str]


RULES = (
    Rule(
        Advice.WAIT,
        lambda it, _: not it.arrives,
        lambda it: f"the needle does not reach the target within {it.reach_s:.1f} s",
    ),
    Rule(
        Advice.REALIGN,
        lambda it, _: it.behind,
        lambda _: "the target does not lie before the needle: turn it, or enter elsewhere",
    ),
    Rule(
        Advice.REALIGN,
        lambda it, settings: it.depth_m < -settings.overshot_m,
        lambda it: f"the tip is {-1e3 * it.depth_m:.1f} mm too deep: draw it back",
    ),
    Rule(
        Advice.GO,
        lambda it, settings: it.probability >= settings.go and it.best_probability <= it.probability + settings.worth,
        lambda it: f"a hit is {_percent(it.probability)} probable",
    ),
    Rule(
        Advice.WAIT,
        lambda it, settings: it.best_probability >= settings.go,
        lambda it: (
            f"in {it.best_in_s:.1f} s a hit is {_percent(it.best_probability)} probable, now {_percent(it.probability)}"
        ),
    ),
    Rule(
        Advice.REALIGN,
        lambda it, settings: it.turned_probability >= settings.go,
        lambda it: (
            f"turned by {np.degrees(it.turn_rad):.1f} deg a hit is {_percent(it.turned_probability)} probable, "
            f"now {_percent(it.probability)}"
        ),
    ),
    Rule(
        Advice.WAIT,
        lambda _it, _: True,
        lambda it: (
            f"even well aimed a hit is {_percent(max(it.probability, it.turned_probability))} probable: on arrival "
            f"the target is uncertain by {1e3 * it.target_sd_m:.2g} mm, the tip by {1e3 * it.tip_sd_m:.2g} mm"
        ),
    ),
)
"""Rules for a healthy estimate, in order; the first rule whose condition holds gives the advice."""


def decide(prospect: Prospect, settings: AdviceSettings, rules: Sequence[Rule] = RULES) -> tuple[Advice, str]:
    """Advice and reason of the first rule whose condition holds; raises LookupError if no condition holds."""
    for rule in rules:
        if rule.holds(prospect, settings):
            return rule.advice, rule.reason(prospect)
    raise LookupError(f"advice: expected one of {len(rules)} rules to hold, found none for {prospect}")


class PathSource(Protocol):
    """Protocol of a filter that `guide` can use."""

    @property
    def seen_s(self) -> float | None:
        """Time of the last used mark [s]; None before the first mark."""

    def predict_path(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Means (k, dim) and covariances (k, dim, dim) of the target at later times [s], (k,)."""


def path_times(
    estimate: TargetEstimate, insertion: Insertion, needle: Needle, settings: AdviceSettings, now_s: float
) -> Floats:
    """Times at which `guide` needs the predicted path [s], (k,): from now_s to the arrival of the latest insertion.

    A path for a slow needle ends `MOST_S` after the latest start.
    Raises ValueError if the dimensions of the estimate and the insertion differ.
    """
    if len(estimate.mean) != len(insertion.entry):
        found = f"{len(estimate.mean)} and {len(insertion.entry)}"
        raise ValueError(f"dimensions: expected the same for estimate and insertion, found {found}")
    way_s = time_to(float(np.linalg.norm(estimate.mean - insertion.entry)), insertion, needle)
    n_times = int(np.ceil((settings.horizon_s + min(way_s, MOST_S)) / PATH_STEP_S)) + 2
    return now_s + PATH_STEP_S * np.arange(n_times, dtype=np.float64)


def guide(
    filter_: PathSource | TissueFilter,
    estimate: TargetEstimate,
    insertion: Insertion,
    lesion: Lesion,
    *,
    needle: Needle | None = None,
    settings: AdviceSettings | None = None,
    now_s: float | None = None,
    path_at: Callable[[Floats], TargetPath] | None = None,
) -> Guidance:
    """Advice from a filter and its last estimate.

    now_s: time of the advice [s]; default: time of the estimate
    path_at: function from times [s], (n,), to a predicted path that covers these times. Default: `kept_path` for a
        `TissueFilter`, and `PathSource.predict_path` for any other filter
    """
    needle = Needle() if needle is None else needle
    settings = AdviceSettings() if settings is None else settings
    now_s = estimate.time_s if now_s is None else now_s
    fault = health_fault(estimate, now_s, filter_.seen_s, settings)
    if fault is not None:
        return Guidance(Advice.NO_GUIDANCE, fault)
    times = path_times(estimate, insertion, needle, settings, now_s)
    if path_at is not None:
        path = path_at(times)
    elif isinstance(filter_, TissueFilter):
        path = kept_path(filter_, times)
    else:
        path = TargetPath(times, *filter_.predict_path(times))
    return advise(path, insertion, lesion, needle=needle, settings=settings, now_s=now_s)


def advise(
    path: TargetPath,
    insertion: Insertion,
    lesion: Lesion,
    *,
    needle: Needle | None = None,
    settings: AdviceSettings | None = None,
    now_s: float | None = None,
) -> Guidance:
    """Advice from a predicted path. The caller has to check with `health_fault` that the filter's estimate may be used.

    now_s: time of the advice [s]; default: first time of the path. Raises ValueError if dimensions differ, or if the
    path does not cover the time from now to the latest start of an insertion.
    """
    needle = Needle() if needle is None else needle
    settings = AdviceSettings() if settings is None else settings
    now_s = float(path.times_s[0]) if now_s is None else now_s
    if not path.means.shape[1] == len(insertion.entry) == lesion.dim:
        found = (path.means.shape[1], len(insertion.entry), lesion.dim)
        raise ValueError(f"dimensions: expected the same for path, insertion and lesion, found {found}")
    n_starts = int(settings.horizon_s / settings.step_s + 1e-9) + 1
    starts = now_s + settings.step_s * np.arange(n_starts, dtype=np.float64)
    if not path.times_s[0] <= now_s <= starts[-1] <= path.times_s[-1]:
        raise ValueError(
            f"path: expected times from {now_s} to {starts[-1]} s, found {path.times_s[0]} to {path.times_s[-1]} s"
        )
    predicted = (path.times_s, path.means, *path.parts)
    line = (insertion.entry, insertion.axis, insertion.speed_m_s, insertion.depth_m, needle.reach_m)
    sampled = needle.sampled
    to_ball = lesion.to_ball
    arrivals, depths, aims, p = insert_each(starts, predicted, line, needle.spread, to_ball, *sampled, False)
    _, _, turned_aims, turned_p = insert_each(starts[:1], predicted, line, needle.spread, to_ball, *sampled, True)
    p[depths < needle.reach_m] = 0.0  # the target is not in front of the needle
    outlook = Outlook(starts, arrivals, p)
    best = int(np.argmax(p))
    later, p_best = float(starts[best] - now_s), float(p[best])
    reach_s = float(path.times_s[-1] - now_s)
    if not np.isfinite(arrivals[0]):  # needles that start later do not arrive either
        what, reason = decide(Prospect(0.0, False, reach_s, 0.0, 0.0), settings)
        return Guidance(what, reason, outlook=outlook)
    beside = aims[0] - insertion.entry
    across = beside - (beside @ insertion.axis) * insertion.axis
    turned = turned_aims[0] - insertion.entry if np.isfinite(turned_aims[0, 0]) else beside
    turned_axis = turned / max(float(np.linalg.norm(turned)), 1e-12)
    cosine, sine = float(turned_axis @ insertion.axis), turned_axis - (turned_axis @ insertion.axis) * insertion.axis
    turn = float(np.arctan2(np.linalg.norm(sine), cosine))
    deeper = float(depths[0] - insertion.depth_m)
    turned_probability = float(turned_p[0])
    cov, depth_m = _cov_at(path, float(arrivals[0])), float(depths[0])
    prospect = Prospect(
        float(p[0]),
        True,
        reach_s,
        later,
        p_best,
        turn_rad=turn,
        turned_probability=turned_probability,
        depth_m=deeper,
        behind=depth_m < needle.reach_m,
        target_sd_m=_largest_sd(cov),
        tip_sd_m=_largest_sd(needle.tip_cov(insertion.axis, depth_m)),
    )
    what, reason = decide(prospect, settings)
    return Guidance(
        what,
        reason,
        arrival_s=float(arrivals[0]),
        probability=float(p[0]),
        aim=aims[0],
        cov=cov,
        lateral_m=float(np.linalg.norm(across)),
        depth_m=deeper,
        turn_rad=turn,
        turned_axis=turned_axis,
        turned_probability=turned_probability,
        best_in_s=later,
        best_probability=p_best,
        outlook=outlook,
    )


def _percent(p: float) -> str:
    """Percentage, rounded down, so that a probability below 1 is never shown as 100 %."""
    return f"{int(100.0 * p)} %"


def _largest_sd(cov: Floats) -> float:
    return float(np.sqrt(np.linalg.eigvalsh(cov)[-1]))


def _cov_at(path: TargetPath, time_s: float) -> Floats:
    j = int(np.searchsorted(path.times_s[1:-1], time_s))
    share = (time_s - path.times_s[j]) / (path.times_s[j + 1] - path.times_s[j])
    return (1.0 - share) * path.covs[j] + share * path.covs[j + 1]
