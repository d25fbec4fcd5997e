"""Health of a filter: a state machine that decides after each frame whether the estimate can be relied upon."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, sqrt

from estimators.tissue.estimate import Status
from estimators.tissue.settings import FilterSettings

LEAST_FRAMES = 2
"""Smallest number of frames whose innovations are tested together."""


@dataclass(frozen=True, slots=True)
class Health:
    """Health of the filter after a frame.

    status: see `Status`
    since_s: time of the first mark after the last start, loss or divergence [s]; None before the first mark
    seen_s: time of the last used mark [s]; -inf before the first mark
    innovations: (time [s], NIS, degrees of freedom) for each frame of the last test_s
    """

    status: Status = Status.INITIALISING
    since_s: float | None = None
    seen_s: float = -inf
    innovations: tuple[tuple[float, float, int], ...] = ()


def after_frame(health: Health, time_s: float, nis: float | None, degrees: int, settings: FilterSettings) -> Health:
    """The health after a frame.

    nis: normalised innovation squared (NIS) of the used marks, None without marks; degrees: degrees of freedom of nis
    confirm_s, lost_s, test_s: in `settings`

    Until marks have been used for confirm_s, the status is INITIALISING. Then it is TRACKING in frames with marks, and
    COASTING in frames without marks. If no marks are used for longer than lost_s, the status is LOST. The next marks
    lead to INITIALISING. If the sum of the NIS over test_s is too large, the status is DIVERGED, and the filter
    restarts. If the restarted filter agrees with the marks for test_s, the status is TRACKING again.
    """
    if nis is None:
        return replace(health, status=_unseen(health, time_s, settings))
    lost = health.status is Status.LOST
    since_s = time_s if lost or health.since_s is None else health.since_s
    kept = () if lost else health.innovations
    recent = tuple(entry for entry in kept if entry[0] > time_s - settings.test_s) or kept[1 - LEAST_FRAMES :]
    innovations = (*recent, (time_s, nis, degrees))
    known = Health(health.status, since_s, time_s, innovations)
    if len(innovations) >= LEAST_FRAMES and diverged(innovations, settings.test_sigmas):
        return Health(Status.DIVERGED, time_s, time_s)
    if health.status is Status.DIVERGED and time_s - since_s < settings.test_s:
        return known
    started = time_s - since_s >= settings.confirm_s
    return replace(known, status=Status.TRACKING if started else Status.INITIALISING)


def _unseen(health: Health, time_s: float, settings: FilterSettings) -> Status:
    if health.since_s is None:
        return Status.INITIALISING
    if time_s - health.seen_s > settings.lost_s:
        return Status.LOST
    return Status.COASTING if health.status is Status.TRACKING else health.status


def diverged(innovations: Sequence[tuple[float, float, int]], sigmas: float) -> bool:
    """Whether the sum of the NIS is larger than the degrees of freedom times `largest_ratio`."""
    degrees = sum(entry[2] for entry in innovations)
    return degrees > 0 and sum(entry[1] for entry in innovations) > degrees * largest_ratio(degrees, sigmas)


def largest_ratio(degrees: int, sigmas: float) -> float:
    """Largest plausible ratio of a sum of NIS to its degrees of freedom: a quantile of the chi-square distribution.

    sigmas: quantile of the standard normal distribution with the same probability. Source: [wilson1931].
    """
    spread = 2.0 / (9.0 * degrees)
    return (1.0 - spread + sigmas * sqrt(spread)) ** 3
