"""The gate: marks too far from where they may be are rejected, until later ones confirm them.

An outlier seldom comes twice to one place. What is seen beyond the gate again, about where it was seen before, is the
tissue: after an impulse with the next frame, from further away after confirm_s.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynamics import SAME_STEP
from estimators.arrays import Floats
from estimators.filters.kernels import squared_mahalanobis
from estimators.tissue.estimate import MarkMeasurement
from estimators.tissue.settings import FilterSettings

Expected = Callable[[str, Floats | None], tuple[Floats, Floats]]
"""Mean [m] and covariance [m²] of where a node's mark may be, given its name and what calibration moves its mark by."""


CROWD = 4
"""Marks of one frame that are not all outliers: of four, at one in thirty, once in eight hours at 30 frames/s."""


@dataclass(frozen=True, slots=True, eq=False)
class Outlying:
    """What was last seen beyond the gate: a mark or a fix.

    since_s, last_s: since when it has been seen there without a break, and when last [s]
    position, cov: of the last one [m], (dim,), [m²], (dim, dim)
    """

    since_s: float
    last_s: float
    position: Floats
    cov: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """What the gate is to know of a frame: its time, that of the frame before, -inf for none [s], and settings.

    considered: whether `shared` of the marks is an error that the filter's columns hold, and not noise of each
    """

    time_s: float
    before_s: float
    settings: FilterSettings
    considered: bool


@dataclass(frozen=True, slots=True, eq=False)
class Gated:
    """Marks on either side of the gate.

    accepted: marks to take in; rejected: nodes of the others
    outlying: by node, what was seen of it beyond the gate
    log_likelihood: of the rejected marks, each as if it lay as far away as an impulse could have brought it
    """

    accepted: list[MarkMeasurement]
    rejected: tuple[str, ...]
    outlying: dict[str, Outlying]
    log_likelihood: float


def gate_marks(
    marks: Sequence[MarkMeasurement],
    expected: Expected,
    after_impulse: Expected,
    outlying: Mapping[str, Outlying],
    *,
    frame: Frame,
) -> Gated:
    """Marks within the gate, and those beyond it that earlier ones confirm.

    Where frames are further apart than an impulse lasts, the next one comes too late to confirm it: then it is believed
    at once, but for a mark of a single node that others within the gate contradict. Where a CROWD of them, half of a
    frame's or more, lie beyond the gate together, it is the estimate that is wrong, and all are taken.
    expected, after_impulse: where marks may be, and where an impulse since they were last used could have brought them
    """
    settings, time_s = frame.settings, frame.time_s
    accepted, rejected, seen, log_likelihood = [], [], dict(outlying), 0.0
    squared = [squared_distance(mark, expected, considered=frame.considered) for mark in marks]
    beyond = {mark.node for mark, distance in zip(marks, squared, strict=True) if distance > settings.gate}
    slow = time_s - frame.before_s > settings.impulse_s * (1.0 + SAME_STEP)
    crowd = len(beyond) >= CROWD and 2 * len(beyond) >= len(marks)
    at_once = slow and (len(beyond) > 1 or min(squared, default=0.0) > settings.gate)
    for mark, distance in zip(marks, squared, strict=True):
        if distance <= settings.gate:
            seen.pop(mark.node, None)
            accepted.append(mark)
            continue
        since_s = _seen_since(mark, seen, frame)
        if (
            crowd
            or time_s - since_s > settings.confirm_s
            or (
                (at_once or time_s > since_s)
                and squared_distance(mark, after_impulse, considered=frame.considered) <= settings.gate
            )
        ):
            accepted.append(mark)
        else:
            rejected.append(mark.node)
            log_likelihood += _log_density_at_gate(mark, after_impulse, settings.gate)
    return Gated(accepted, tuple(rejected), seen, log_likelihood)


def gate_start(
    marks: Sequence[MarkMeasurement],
    expected: Expected,
    outlying: Mapping[str, Outlying],
    *,
    frame: Frame,
    n_marked: int,
) -> Gated:
    """Marks to start from: those within the gate of where a start expects them, and several beyond it together.

    Marks of several nodes beyond it show that the tissue is elsewhere. One of a single node does not: nothing speaks
    for it but itself. Where the tissue has no other mark, n_marked 1, it is confirmed by being there for confirm_s.
    """
    settings = frame.settings
    squared = [squared_distance(mark, expected, considered=frame.considered) for mark in marks]
    beyond = {mark.node for mark, distance in zip(marks, squared, strict=True) if distance > settings.gate}
    accepted, rejected, seen, log_likelihood = [], [], dict(outlying), 0.0
    for mark in marks:
        if mark.node not in beyond:
            seen.pop(mark.node, None)
            accepted.append(mark)
            continue
        since_s = _seen_since(mark, seen, frame)
        if len(beyond) > 1 or (n_marked == 1 and frame.time_s - since_s > settings.confirm_s):
            accepted.append(mark)
        else:
            rejected.append(mark.node)
            log_likelihood += _log_density_at_gate(mark, expected, settings.gate)
    return Gated(accepted, tuple(rejected), seen, log_likelihood)


def squared_distance(mark: MarkMeasurement, expected: Expected, *, considered: bool) -> float:
    """Squared Mahalanobis distance of a mark from where it is expected."""
    shared = mark.shared if considered else None
    mean, cov = expected(mark.node, shared)
    y = mark.position - mean
    return float(squared_mahalanobis(y, cov + (mark.total_cov if shared is None else mark.cov)))


def confirmed(known: Outlying, now: Outlying, settings: FilterSettings) -> bool:
    """Whether what was seen now lies within the gate of what was seen then, moved by an impulse meanwhile."""
    reach = settings.impulse_m_s * min(now.last_s - known.last_s, settings.impulse_s)
    y = now.position - known.position
    S = known.cov + now.cov + reach**2 * np.eye(len(y))
    return float(squared_mahalanobis(y, S)) <= settings.gate


def _seen_since(mark: MarkMeasurement, seen: dict[str, Outlying], frame: Frame) -> float:
    """Since when a mark beyond the gate has been seen about there [s]; noted in `seen`.

    A frame without it is a break, unless the last one with it is no longer ago than confirm_s.
    """
    now, known = Outlying(frame.time_s, frame.time_s, mark.position, mark.total_cov), seen.get(mark.node)
    if (
        known is not None
        and (known.last_s >= frame.before_s or now.last_s - known.last_s <= frame.settings.confirm_s)
        and confirmed(known, now, frame.settings)
    ):
        now = Outlying(known.since_s, now.last_s, now.position, now.cov)
    seen[mark.node] = now
    return now.since_s


def _log_density_at_gate(mark: MarkMeasurement, expected: Expected, gate: float) -> float:
    S = expected(mark.node, None)[1] + mark.total_cov
    return -0.5 * (gate + float(np.linalg.slogdet(2.0 * np.pi * S)[1]))
