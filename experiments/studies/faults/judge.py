"""Evaluation of a live run with a fault: when the fault is displayed, and how often the advice GO is wrong."""

from __future__ import annotations

import logging
import re
import tempfile
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy.stats import chi2

from experiments.arrays import Floats
from experiments.log import LOG

ONSET_S = 4.0
"""Time from the first exposure to the onset of a fault [s]: long enough to fit the breathing model."""
LASTS_S = 2.0
FOREVER = np.inf
FRAME_S = 0.2
"""Time limit for the display of a fault that a single frame shows [s]. The required limit is this time or three frame
intervals, whichever is longer."""
HIDDEN_S = 2.0
"""Time limit for a fault that no single frame shows [s]. By then, the fault must be displayed, or the covariance must
cover the error that the fault causes; a requirement."""
WRONG = 0.999
"""Probability that a region around the mean contains the truth. `is_wrong` uses this region."""
LEAST_M = 1e-3
"""If the target's error is at most this length [m], the estimate is not wrong; choice: too small to affect a needle."""
STALE_S = 0.2
"""If the displayed state is older than this [s], GO must not be displayed; a requirement."""
STEADY_S = 0.5
"""Time without faults after which a run has recovered [s]; choice."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """What a live run displays at one time, compared with the truth.

    time_s: time since the first exposure [s]; age_s: age of the newest frame that the estimate uses [s]
    of_frame: whether a new frame changed the display
    status, advice: displayed status and advice; advice is None if no advice is displayed
    why: the displayed fault, or the reason of ABORT or REALIGN; empty if there is neither
    reported: new event messages; empty if there are none
    sigma_m: standard deviation of the target's position [m]
    wrong: whether the estimate is wrong, see `is_wrong`; astray: whether the needle would miss the lesion
    well: whether the status is TRACKING and `why` is empty
    said: the displayed fault; if there is none, the reason of the advice, whatever the advice is
    error_m: error of the target's position [m]; covered: whether the truth lies in the 95 % region
    """

    time_s: float
    age_s: float
    status: str
    advice: str | None
    why: str
    sigma_m: float
    wrong: bool
    well: bool
    reported: str = ""
    astray: bool = False
    of_frame: bool = True
    said: str = ""
    error_m: float = np.nan
    covered: bool = False

    @property
    def faulty_go(self) -> bool:
        """Whether GO was displayed although the estimate was wrong or too old, or the needle would miss."""
        return self.advice == "GO" and (self.wrong or self.astray or self.age_s > STALE_S)

    @property
    def words(self) -> str:
        """Text of the displayed fault; empty if no fault is displayed."""
        if self.well:
            return self.reported
        what = self.advice if self.advice in ("ABORT", "REALIGN") else self.status
        return f"{what}: {self.why}" if self.why else what


@dataclass(frozen=True, slots=True)
class Judged:
    """The result of a run with a fault.

    The evaluated period begins at the fault's time limit `Fault.within_s`. It ends when the run has recovered. If the
    fault lasts to the end of the run, the period lasts to the end of the run, too.

    noticed_ms: time from the fault's onset to its first display [ms]; None if it is never displayed
    covered: whether no estimate is wrong in the evaluated period
    shown: the fault text displayed most often during the fault; if there is none, the first event message
    recovered_ms: time from the fault's end to the recovery [ms]; None if the run never recovers. If the fault has no
        end, time from the fault's onset to the recovery.
    sigma_before_mm: median standard deviation of the target's position in the second before the fault [mm]
    sigma_most_mm: largest standard deviation of the target's position during the fault [mm]
    go_shown_while_faulty: number of displays of a wrong GO in the evaluated period, see `Moment.faulty_go`
    go: number of displays of GO after the onset
    ended: how the process ended; empty if the run had no process of its own
    lacks_s: duration that is missing at the end of tables or recording [s]; None if the run writes none
    """

    noticed_ms: float | None
    covered: bool
    shown: str
    recovered_ms: float | None
    sigma_before_mm: float
    sigma_most_mm: float
    go_shown_while_faulty: int
    go: int
    ended: str = ""
    lacks_s: float | None = None


@dataclass(frozen=True, slots=True)
class Fault(ABC):
    """A fault, with its simulation and its evaluation.

    name: name of the fault in the table; what: a short description of the fault
    lasts_s: duration of the fault [s]; inf if the fault lasts to the end of the run. The fault begins at ONSET_S.
    within_s: time limit after the onset [s]. By then, the fault must be displayed, or the covariance must cover the
        error that the fault causes.
    alone: whether the run is in real time, so that no other run may use the machine
    """

    name: str
    what: str
    lasts_s: float = LASTS_S
    within_s: float = FRAME_S
    alone: ClassVar[bool] = False

    @abstractmethod
    def judged(self, seed: int, folder: Path) -> Judged:
        """Do a run with this fault, and return the result; folder: an existing folder for the run's output."""


@contextmanager
def quiet_folder() -> Iterator[Path]:
    """Context with a temporary folder for a run's output. Within the context, logging is off."""
    level = LOG.level
    LOG.setLevel(logging.CRITICAL)
    try:
        with tempfile.TemporaryDirectory() as folder:
            yield Path(folder)
    finally:
        LOG.setLevel(level)


def is_wrong(mean: Floats, cov: Floats | None, truth_m: Floats) -> bool:
    """Whether the covariance is unknown, or the error exceeds `LEAST_M` and the truth is outside the 99.9 % region."""
    is_near = cov is not None and np.isfinite(cov).all() and np.linalg.norm(truth_m - mean) <= LEAST_M
    return not (is_near or covers(mean, cov, truth_m, WRONG))


def covers(mean: Floats, cov: Floats | None, truth_m: Floats, probability: float = 0.95) -> bool:
    """Whether the truth [m], (dim,), lies in the region of this probability; False if mean or cov is not known."""
    if cov is None or not np.isfinite(mean).all() or not np.isfinite(cov).all():
        return False
    off = truth_m - mean
    return bool(off @ np.linalg.solve(cov, off) <= chi2.ppf(probability, len(off)))


def verdict(fault: Fault, moments: list[Moment], lasts_s: float) -> Judged:
    """The result of a run; moments: what the run displayed at each time; lasts_s: duration of the fault [s]."""
    stays, ends_s = np.isinf(lasts_s), ONSET_S + lasts_s
    before = [one for one in moments if ONSET_S - 1.0 <= one.time_s < ONSET_S]
    during = [one for one in moments if ONSET_S <= one.time_s < ends_s]
    after = [one for one in moments if one.time_s >= ONSET_S]
    noticed_s = next((one.time_s for one in after if not one.well or one.reported), None)
    recovered_s = _recovered(after, ONSET_S if stays else ends_s, noticed_s)
    over_s = np.inf if recovered_s is None or stays else recovered_s
    faulty = [one for one in after if ONSET_S + fault.within_s <= one.time_s < over_s]
    go = [one for one in after if one.advice == "GO"]
    return Judged(
        None if noticed_s is None else 1e3 * (noticed_s - ONSET_S),
        not any(one.wrong for one in faulty),
        _most_shown(during),
        None if recovered_s is None else 1e3 * (recovered_s - (ONSET_S if stays else ends_s)),
        1e3 * float(np.median([one.sigma_m for one in before])) if before else np.nan,
        1e3 * max((one.sigma_m for one in during), default=0.0),
        sum(one.faulty_go for one in faulty),
        len(go),
    )


def _most_shown(moments: list[Moment]) -> str:
    """The fault text displayed most often, where numbers do not matter; if there is none, the first event message."""
    ill = [one.words for one in moments if not one.well]
    if not ill:
        return next((one.reported for one in moments if one.reported), "")
    kinds = [re.sub(r"\d+(\.\d+)?", "0", words) for words in ill]
    (most, _), *_ = Counter(kinds).most_common(1)
    return ill[kinds.index(most)]


def _recovered(after: list[Moment], over_s: float, noticed_s: float | None) -> float | None:
    """Start of the first `STEADY_S` without displayed fault or wrong estimate, from over_s on [s]; None without any."""
    if noticed_s is None:
        return over_s
    began_s: float | None = None
    for one in after:
        if one.time_s < max(over_s, noticed_s) or not one.well or one.wrong:
            began_s = None
        elif began_s is None:
            began_s = one.time_s
        elif one.time_s - began_s >= STEADY_S:
            return began_s
    return None
