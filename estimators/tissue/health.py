"""Whether an estimate may be relied upon: a state machine fed by what each frame gave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, sqrt

from estimators.tissue.estimate import Status
from estimators.tissue.settings import FilterSettings

LEAST_FRAMES = 2
"""Frames whose innovations are tested together, at least: the fewest that are together; one is for the gate."""

MANY_BLOWS = 2.5
"""Blows within test_s, by the sum of their probabilities, beyond which they explain nothing any more; numerical: there
may be two, and a third need only be likelier than not."""


@dataclass(frozen=True, slots=True)
class Health:
    """What is known of the filter's health after a frame.

    status: see `Status`
    since_s: time [s] since which marks have been taken in without a gap that lost the target; None before the first
    seen_s: when a mark was last taken in [s], -inf before the first
    innovations: (time [s], NIS, degrees of freedom, probability of a blow) of the frames in the test
    """

    status: Status = Status.INITIALISING
    since_s: float | None = None
    seen_s: float = -inf
    innovations: tuple[tuple[float, float, int, float], ...] = ()


def after_frame(
    health: Health,
    time_s: float,
    nis: float | None,
    degrees: int,
    settings: FilterSettings,
    *,
    blow: float = 0.0,
) -> Health:
    """The health after a frame that brought marks of this NIS and so many coordinates, or none (nis None).

    blow: probability that one has just struck the tissue

    INITIALISING until marks were taken in for confirm_s, for one frame shows no velocity. Then TRACKING with each frame
    that brings marks. Without marks COASTING, from lost_s on LOST, whence marks lead to INITIALISING; frames that come
    further apart than lost_s but bring marks lose nothing. DIVERGED as soon as the innovations of test_s are too large
    together, or ever new blows are to explain them, in any of these; the filter then starts anew, and after test_s of
    marks that fit the target is tracked again.
    """
    if nis is None:
        return replace(health, status=_unseen(health, time_s, settings))
    lost = health.status is Status.LOST
    since_s = time_s if lost or health.since_s is None else health.since_s
    kept = () if lost else health.innovations
    recent = tuple(entry for entry in kept if entry[0] > time_s - settings.test_s) or kept[1 - LEAST_FRAMES :]
    innovations = (*recent, (time_s, nis, degrees, blow))
    known = Health(health.status, since_s, time_s, innovations)
    struck = sum(entry[3] for entry in innovations) > MANY_BLOWS
    if len(innovations) >= LEAST_FRAMES and (struck or diverged(innovations, settings.test_sigmas)):
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
    return Status.DIVERGED if health.status is Status.DIVERGED else Status.COASTING


def diverged(innovations: Sequence[tuple[float, float, int, float]], sigmas: float) -> bool:
    """Whether the sum of these NIS lies further out than so many standard deviations of a normal variable."""
    degrees = sum(entry[2] for entry in innovations)
    return degrees > 0 and sum(entry[1] for entry in innovations) > degrees * largest_ratio(degrees, sigmas)


def largest_ratio(degrees: int, sigmas: float) -> float:
    """NIS by its degrees of freedom so many standard deviations of a normal variable out.

    Sums of NIS are chi-square; Wilson and Hilferty's cube root makes them normal [wilson1931].
    """
    spread = 2.0 / (9.0 * degrees)
    return (1.0 - spread + sigmas * sqrt(spread)) ** 3
