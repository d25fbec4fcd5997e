"""Marks predicted as if they were hidden: what their errors say of the target, whose errors nobody sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimators import LeaveOneOutCheck


@dataclass(frozen=True, slots=True)
class Withheld:
    """How one mark was predicted by the filter that never gets it.

    frames: in which it was seen and predicted; mean_error_mm: distance from the prediction; mean_nees: the dimension is
    right; ratio: root mean square of errors by what was predicted of them, 1 is right
    """

    frames: int
    mean_error_mm: float
    mean_nees: float
    ratio: float


def withheld_of(checks: Sequence[LeaveOneOutCheck]) -> Withheld:
    """Of the predictions of one mark, one or more."""
    errors = np.array([one.error for one in checks])
    nees = float(np.mean([one.nees for one in checks]))
    distances = np.linalg.norm(errors, axis=1)
    return Withheld(len(checks), 1e3 * float(distances.mean()), nees, float(np.sqrt(nees / errors.shape[1])))


def withheld_words(withheld: Mapping[str, Withheld], scale: float) -> str:
    """What the check means for the target, in one sentence; scale: factor on the target's covariance, 1 or more."""
    if not withheld:
        return "no mark was predicted as if hidden while the others were tracked: the check says nothing"
    worst = max(withheld, key=lambda node: withheld[node].ratio)
    ratio = withheld[worst].ratio
    meant = "the target, hidden too, may be off as much" if ratio > 1.0 else "so the target's sigma can be believed"
    widened = f"was made {scale**0.5:.2f} times as large" if scale > 1.0 else "was left as it is"
    return (
        f"marks predicted as if hidden are off by up to {ratio:.2f} times the predicted ({worst}): "
        f"{meant}; sigma of the target {widened}"
    )
