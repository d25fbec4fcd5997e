"""Association of detections with the marks of nodes: one assignment for the whole frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from vision.detection.expected import Expected
from vision.detection.hue import hue_distance
from vision.detection.records import Detection
from vision.tracking.settings import FINDER

SAME_CLASS_DEG = 1.0
"""Largest difference between two hues of the same kind of mark [degrees]. It allows for rounding in files."""


@dataclass(frozen=True, slots=True, eq=False)
class AssociatedMark:
    """A detection with the name of its mark's node."""

    name: str
    detection: Detection


def squared_distance(expected: Expected, detection: Detection) -> float:
    """Squared Mahalanobis distance of a detection from a mark's expected position."""
    (x, y), ((xx, xy), (_, yy)) = expected.center_px.tolist(), expected.cov_px2.tolist()
    (u, v), ((uu, uv), (_, vv)) = detection.center_px.tolist(), detection.cov_px2.tolist()
    a, b, c, du, dv = xx + uu, xy + uv, yy + vv, u - x, v - y
    return float((c * du * du - 2.0 * b * du * dv + a * dv * dv) / (a * c - b * b))


def associate_marks(
    detections: Sequence[Detection], expected: Sequence[Expected], *, gate: float = FINDER.association.gate
) -> list[AssociatedMark]:
    """Assign detections to marks. Returns the pairs in the order of `expected`; marks without a detection are omitted.

    A detection may be assigned to a mark of the same hue if its squared Mahalanobis distance d² is at most `gate`. Of
    the assignments with the most pairs, the most probable is chosen: it has the least sum of d² + log det S. S is the
    innovation covariance.
    """
    if not detections or not expected:
        return []
    found_px = np.array([d.center_px for d in detections])
    means_px = np.array([e.center_px for e in expected])
    S = np.array([e.cov_px2 for e in expected])[:, None] + np.array([d.cov_px2 for d in detections])[None, :]
    innovations = found_px[None, :] - means_px[:, None]
    # In closed form for (2, 2): inv(S) = [[S_vv, -S_uv], [-S_uv, S_uu]] / det S
    det = S[..., 0, 0] * S[..., 1, 1] - S[..., 0, 1] * S[..., 1, 0]
    definite = (det > 0) & (S[..., 0, 0] > 0)
    if not definite.all():
        k = int(np.argwhere(~definite)[0, 0])
        raise ValueError(f"expected mark {expected[k].name}: expected a positive definite covariance, found {S[k, 0]}")
    cross = (S[..., 0, 1] + S[..., 1, 0]) * innovations[..., 0] * innovations[..., 1]
    squared = (S[..., 1, 1] * innovations[..., 0] ** 2 - cross + S[..., 0, 0] * innovations[..., 1] ** 2) / det
    hues, found = np.array([e.hue_deg for e in expected]), np.array([d.hue_deg for d in detections])
    allowed = (hue_distance(hues[:, None], found) <= SAME_CLASS_DEG) & (squared <= gate)
    if not allowed.any():
        return []
    cost = squared + np.log(det)
    # A forbidden pair costs more than the difference between any two sets of allowed pairs: it is the last choice.
    forbidden = cost[allowed].max() + (1.0 + np.ptp(cost[allowed])) * min(cost.shape)
    rows, columns = linear_sum_assignment(np.where(allowed, cost, forbidden))
    return [
        AssociatedMark(expected[i].name, detections[j]) for i, j in zip(rows, columns, strict=True) if allowed[i, j]
    ]
