"""The gate: marks too far from where they may be are rejected, until they stay there for too long to be outliers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats
from estimators.tissue.estimate import MarkMeasurement
from estimators.tissue.settings import FilterSettings

Expected = Callable[[str, Floats | None], tuple[Floats, Floats]]
"""Mean [m] and covariance [m²] of where a node's mark may be, given its name and what calibration moves its mark by."""


@dataclass(frozen=True, slots=True, eq=False)
class Gated:
    """Marks on either side of the gate.

    accepted: marks to take in; rejected: nodes of the others
    outlying_s: by node, since when its mark has been beyond the gate [s]
    log_likelihood: of the rejected marks, each as if it lay at the gate
    """

    accepted: list[MarkMeasurement]
    rejected: tuple[str, ...]
    outlying_s: dict[str, float]
    log_likelihood: float


def gate_marks(
    marks: Sequence[MarkMeasurement],
    expected: Expected,
    outlying_s: Mapping[str, float],
    *,
    time_s: float,
    settings: FilterSettings,
    considered: bool,
) -> Gated:
    """Marks within the gate of where an impulse could have brought them, or beyond it for longer than confirm_s.

    Outliers pass; what stays away is the tissue.
    considered: whether `shared` of the marks is an error that the filter's columns hold, and not noise of each
    """
    accepted, rejected, since, log_likelihood = [], [], dict(outlying_s), 0.0
    for mark in marks:
        if squared_distance(mark, expected, considered=considered) <= settings.gate:
            since.pop(mark.node, None)
        elif time_s - since.setdefault(mark.node, time_s) <= settings.confirm_s:
            rejected.append(mark.node)
            S = expected(mark.node, None)[1] + mark.total_cov
            log_likelihood -= 0.5 * (settings.gate + float(np.linalg.slogdet(2.0 * np.pi * S)[1]))
            continue
        accepted.append(mark)
    return Gated(accepted, tuple(rejected), since, log_likelihood)


def squared_distance(mark: MarkMeasurement, expected: Expected, *, considered: bool) -> float:
    """Squared Mahalanobis distance of a mark from where it is expected."""
    shared = mark.shared if considered else None
    mean, cov = expected(mark.node, shared)
    y = mark.position - mean
    return float(y @ np.linalg.solve(cov + (mark.total_cov if shared is None else mark.cov), y))
