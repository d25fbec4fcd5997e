"""Test of the filter's consistency by its innovations, with a verdict in words.

Innovations test the filter only at the marks. A hidden target needs another test: a known truth, direct measurements,
or the prediction of each mark by a filter that does not use this mark.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimators import LeaveOneOutCheck, Status, TargetEstimate, chi_square_bounds, mean_bounds
from experiments.plain import counted

SETTLED = (Status.TRACKING, Status.DIVERGED)
"""Statuses of frames whose innovations are tested. The first frames are not tested: their prior is still wide."""

COVERED = (0.9, 0.995)
"""Least and largest share [1] of frames whose truth is inside the 95 % region; choice. If the share is smaller, the
covariance is too small; if it is larger, the covariance may be too large."""

ONE_ERROR = 0.999
"""An error that is the same in all frames must lie in a region of this probability [1]; choice. If the error lies
outside, the covariance is too small."""

MOST_NEES = 2.0
"""Largest mean NEES divided by the dimension [1]; choice. Above it, the errors of some frames are too large."""

NOISY = 1.5
"""A message says that marks are noisier than stated if their estimated noise exceeds it by this factor [1]; choice."""

NOISE = "marks are at least {:.1f} times as noisy as stated, which the estimate considers: state a larger sd"

UNTESTED = "this does not test the hidden target; track --check, a fix or a recording that shows the target does"

MISSED = (Status.COASTING, Status.LOST, Status.DIVERGED)
"""Statuses of frames whose estimate is not based on consistent marks, in the order in which a verdict lists them."""


NO_MARKS = "no marks were used after the start: the estimate is a prediction by the model "
LOOK = "(is the hue right? softaim hue)"
CHECK = "(do times, positions and nodes of the table fit the scene?)"


@dataclass(frozen=True, slots=True)
class Fit:
    """Mean NIS of the frames of a run, and its 95 % band for a correct model with correct noise levels.

    degrees: mean number of measured coordinates in a frame, which is the expected NIS of a consistent filter
    low, high: limits of the band; noise: mean estimated ratio of the true to the stated standard deviation of marks [1]
    """

    mean_nis: float
    degrees: float
    low: float
    high: float
    noise: float = 1.0

    @property
    def ratio(self) -> float:
        """Ratio of the observed to the predicted rms innovation, ideally 1."""
        return float(np.sqrt(self.mean_nis / self.degrees))

    @property
    def inside(self) -> bool:
        """Whether the mean NIS lies in the band."""
        return self.low <= self.mean_nis <= self.high


def fit_of(estimates: Sequence[TargetEstimate]) -> Fit | None:
    """The fit of a method's estimates; None if no estimate has a finite NIS."""
    judged = [e for e in estimates if e.nis is not None and e.degrees > 0 and e.status in SETTLED]
    nis = np.array([e.nis for e in judged], dtype=float)
    degrees = np.array([e.degrees for e in judged], dtype=float)
    known = np.isfinite(nis)
    if not known.any():
        return None
    noise = float(np.mean([e.noise for e in judged]))
    mean_degrees, n = float(degrees[known].mean()), int(known.sum())
    return Fit(float(nis[known].mean()), mean_degrees, *mean_bounds(mean_degrees, n), noise)


def sigmas_m(estimates: Sequence[TargetEstimate]) -> list[float]:
    """Standard deviation of the target [m], rms over the axes, of each frame with a finite covariance."""
    traces = [float(np.trace(e.cov)) / len(e.mean) for e in estimates if e.cov is not None]
    return [float(np.sqrt(trace)) for trace in traces if np.isfinite(trace) and trace >= 0.0]


def frames_by_status(estimates: Sequence[TargetEstimate]) -> dict[str, int]:
    """Number of frames with each status; every status has an entry."""
    statuses = [e.status for e in estimates]
    return {str(status): statuses.count(status) for status in Status}


@dataclass(frozen=True, slots=True)
class TruthScore:
    """Score of the target's covariance by the true errors of the target.

    coverage95: share of frames in which the truth lies inside the 95 % region [1]; dim: dimension of the tissue
    one_error: whether most of the variance is due to an error that is the same in all frames, which are then one sample
    """

    coverage95: float
    mean_nees: float
    dim: int
    one_error: bool = False

    @property
    def result(self) -> str:
        """Verdict on the covariance, in words."""
        if self.one_error and self.mean_nees <= chi_square_bounds(self.dim, ONE_ERROR)[1]:
            return "cannot be tested by one recording: it is mostly the error of the target's position in the tissue"
        if self.coverage95 < COVERED[0]:
            return "is too small"
        if self.coverage95 > COVERED[1] and self.mean_nees < self.dim:
            return "is larger than the errors"
        if self.coverage95 < COVERED[1] and self.mean_nees > MOST_NEES * self.dim:
            return "is too small in some frames, whose errors are large"
        return "holds"

    @property
    def is_wide_enough(self) -> bool:
        """Whether the covariance is large enough for the true errors."""
        return self.coverage95 >= COVERED[0] and self.mean_nees <= MOST_NEES * self.dim

    @property
    def words(self) -> str:
        """Text with the scores and the result."""
        return (
            f"the true target lies inside the 95 % region in {100.0 * self.coverage95:.0f} % of frames (NEES"
            f" {self.mean_nees:.3g}, expected {self.dim}): the target's covariance {self.result}"
        )


def verdict(
    fit: Fit | None,
    by_status: Mapping[str, int],
    refused: int = 0,
    *,
    frozen: int = 0,
    pictures: bool = True,
    checked: bool = False,
    truth: TruthScore | None = None,
) -> str:
    """Verdict on a run in words: the test of innovations, what this test cannot show, and numbers of frames by status.

    refused: number of marks that the gate rejected; frozen: number of frames that repeat earlier values
    pictures: whether marks were found in pictures; truth: scores of the target, if its truth is known
    checked: whether each mark was also predicted by a filter that does not use this mark
    """
    frames = sum(by_status.values())
    missed = [(by_status[str(status)], status.lower()) for status in MISSED if by_status[str(status)]]
    if missed:
        (n, word), *others = missed
        together = ", ".join([f"{n} of {frames} frames {word}", *(f"{n} {word}" for n, word in others)])
    else:
        together = f"none of {frames} frames coasting, lost or diverged"
    of_noise = None if fit is None or fit.noise < NOISY else NOISE.format(fit.noise)
    wide = of_noise is None and (truth is None or truth.is_wide_enough)
    of_marks = NO_MARKS + (LOOK if pictures else CHECK) if fit is None else _fit_words(fit, wide)
    of_target = truth.words if truth is not None else None if fit is None or checked else UNTESTED
    counts = [
        together,
        f"{counted(frozen, 'frame')} frozen: their values repeat earlier ones" if frozen else None,
        f"{counted(refused, 'mark')} refused" if refused else None,
    ]
    return "; ".join(part for part in (of_marks, of_noise, of_target, *counts) if part)


def _fit_words(fit: Fit, wide: bool) -> str:
    """Text on the fit, and the cause of a bad fit; wide: whether the cause may be a noise level stated too high."""
    band = f"its band {fit.low:.2f} to {fit.high:.2f}"
    if fit.inside:
        return f"marks scatter as predicted: NIS {fit.mean_nis:.2f} in {band}"
    if fit.ratio < 1.0:
        less = f"{100.0 * (1.0 - fit.ratio):.0f} % less than predicted, NIS {fit.mean_nis:.2f} below {band}"
        cause = ": the marks' sd or strain (softaim tune) is stated too high" if wide else ""
        return f"marks scatter {less}{cause}"
    more = f"{100.0 * (fit.ratio - 1.0):.0f} % more than" if fit.ratio < 2.0 else f"{fit.ratio:.3g} times as much as"
    return (
        f"marks scatter {more} predicted, NIS {fit.mean_nis:.2f} above {band}: "
        "the marks' sd, constants (softaim identify) or strain (softaim tune) are wrong"
    )


@dataclass(frozen=True, slots=True)
class Withheld:
    """Prediction of one mark by a filter that does not use this mark.

    frames: number of frames with the mark and its prediction; mean_error_mm: mean distance of mark and prediction [mm]
    mean_nees: mean NEES, for a consistent filter the dimension of the tissue
    ratio: rms error divided by the predicted rms error, ideally 1
    """

    frames: int
    mean_error_mm: float
    mean_nees: float
    ratio: float


def withheld_of(checks: Sequence[LeaveOneOutCheck]) -> Withheld:
    """Statistics of the predictions of one mark by a filter that does not use this mark."""
    errors = np.array([one.error for one in checks])
    nees = float(np.mean([one.nees for one in checks]))
    distances = np.linalg.norm(errors, axis=1)
    return Withheld(len(checks), 1e3 * float(distances.mean()), nees, float(np.sqrt(nees / errors.shape[1])))


def withheld_words(withheld: Mapping[str, Withheld], scale: float) -> str:
    """What the errors of withheld marks say about the target; scale: mean factor on the target's covariance."""
    if not withheld:
        return "no mark was predicted as if hidden while the others were tracked: the check has no result"
    worst = max(withheld, key=lambda node: withheld[node].ratio)
    ratio = withheld[worst].ratio
    meant = "the hidden target's error may also be larger" if ratio > 1.0 else "the target's sigma is plausible"
    widened = f"was multiplied by {scale**0.5:.2f} on average" if scale > 1.0 else "is unchanged"
    return (
        f"errors of marks predicted as if hidden are up to {ratio:.2f} times as large as predicted, mark noise included"
        f" ({worst}): {meant}; the target's sigma {widened}"
    )
