"""Do the marks fit the model: innovations against the band of a consistent filter, frames by status, a verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimators import Status, TargetEstimate, mean_bounds

SETTLED = (Status.TRACKING, Status.DIVERGED)
"""Frames whose innovations are judged: at a start the prior is wide on purpose."""

MISSED = (Status.COASTING, Status.LOST, Status.DIVERGED)
"""Frames in which the estimate did not rest on marks that fit; in the order in which a verdict names them."""


NO_MARKS = "no marks were taken in after the start: the model alone estimates "
LOOK = "(is the hue right? softaim hue)"
CHECK = "(do times, positions and nodes of the table fit the scene?)"


@dataclass(frozen=True, slots=True)
class Fit:
    """Mean NIS of the frames of a run, and the band that holds it with 95 % where model and noise levels are right.

    frames: how many; degrees: of freedom of a frame, on average: two or three a mark; low, high: the band
    """

    mean_nis: float
    degrees: float
    low: float
    high: float
    frames: int

    @property
    def ratio(self) -> float:
        """How large innovations were, by what the filter predicted of them: 1 is right."""
        return float(np.sqrt(self.mean_nis / self.degrees))

    @property
    def inside(self) -> bool:
        """Whether the mean lies in the band."""
        return self.low <= self.mean_nis <= self.high


def fit_of(estimates: Sequence[TargetEstimate]) -> Fit | None:
    """The fit of a method's estimates; None where it states no NIS, or none that is finite."""
    judged = [e for e in estimates if e.nis is not None and e.marks_used > 0 and e.status in SETTLED]
    nis = np.array([e.nis for e in judged], dtype=float)
    degrees = np.array([len(e.mean) * e.marks_used for e in judged], dtype=float)
    known = np.isfinite(nis)
    if not known.any():
        return None
    mean_degrees, n = float(degrees[known].mean()), int(known.sum())
    return Fit(float(nis[known].mean()), mean_degrees, *mean_bounds(mean_degrees, n), n)


def sigmas_m(estimates: Sequence[TargetEstimate]) -> list[float]:
    """Standard deviation of the target an axis [m] in each frame that has a finite covariance."""
    traces = [float(np.trace(e.cov)) / len(e.mean) for e in estimates if e.cov is not None]
    return [float(np.sqrt(trace)) for trace in traces if np.isfinite(trace) and trace >= 0.0]


def frames_by_status(estimates: Sequence[TargetEstimate]) -> dict[str, int]:
    """How many frames had which status, all of them named."""
    statuses = [e.status for e in estimates]
    return {str(status): statuses.count(status) for status in Status}


def verdict(
    fit: Fit | None, by_status: Mapping[str, int], refused: int = 0, *, frozen: int = 0, pictures: bool = True
) -> str:
    """One sentence: do the marks fit the model, and in how many frames were there any; what to do where not.

    refused: marks that the gate rejected; frozen: frames whose given values repeat; pictures: whether marks were looked
    for in pictures, and not given
    """
    frames = sum(by_status.values())
    missed = [(by_status[str(status)], status.lower()) for status in MISSED if by_status[str(status)]]
    if missed:
        (n, word), *others = missed
        counted = ", ".join([f"{n} of {frames} frames {word}", *(f"{n} {word}" for n, word in others)])
    else:
        counted = f"none of {frames} frames coasting, lost or diverged"
    told = [NO_MARKS + (LOOK if pictures else CHECK) if fit is None else _fit_words(fit), counted]
    if frozen:
        told.append(f"{frozen} frames frozen: their values repeat those before")
    if refused:
        told.append(f"{refused} marks refused")
    return "; ".join(told)


def _fit_words(fit: Fit) -> str:
    band = f"its band {fit.low:.2f} to {fit.high:.2f}"
    if fit.inside:
        return f"the marks fit the model: NIS {fit.mean_nis:.2f} in {band}"
    if fit.ratio < 1.0:
        return (
            f"the marks fit the model, which is cautious: they scatter {100.0 * (1.0 - fit.ratio):.0f} % less than "
            f"predicted, NIS {fit.mean_nis:.2f} below {band} (softaim tune lowers noise levels that are too high)"
        )
    more = f"{100.0 * (fit.ratio - 1.0):.0f} % more than" if fit.ratio < 2.0 else f"{fit.ratio:.3g} times what"
    return (
        f"the marks fit the model badly: they scatter {more} it predicts, NIS {fit.mean_nis:.2f} above {band}: "
        f"constants or noise levels are wrong: softaim identify, softaim tune"
    )
