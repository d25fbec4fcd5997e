"""What was shown while something failed, judged: how fast it was noticed, and whether GO was shown that was wrong."""

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
"""When a fault begins, from the first exposure on [s]: the breath is learnt by then."""
LASTS_S = 2.0
FOREVER = np.inf
FRAME_S = 0.2
"""Within this, or three frames if that is longer, a fault that a frame shows has to be noticed [s]: asked for."""
HIDDEN_S = 2.0
"""Within this a fault that no single frame can show has to be noticed, or the covariance to cover it [s]: asked for."""
WRONG = 0.999
"""An estimate is wrong where the truth lies outside of its region of this probability, and by more than `LEAST_M`."""
LEAST_M = 1e-3
"""A needle does not mind less [m]; chosen."""
STALE_S = 0.2
"""Age of what is shown from which on it must not be GO [s]: asked for."""
STEADY_S = 0.5
"""So long all has to be well again to call it recovered [s]; chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """What was shown at one time [s] from the first exposure on.

    age_s: of the newest frame that was used; status, advice: the words that were shown; advice None for none
    why: the reason that was shown, empty for none; reported: what was reported at that moment, empty for nothing
    sigma_m: of the target
    wrong: whether the truth was outside of the estimate; astray: whether the needle lay so that it would miss
    well: whether nothing was shown but that the target is tracked
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

    @property
    def faulty_go(self) -> bool:
        """Whether GO was shown that was wrong."""
        return self.advice == "GO" and (self.wrong or self.astray or self.age_s > STALE_S)

    @property
    def words(self) -> str:
        """What was shown of the fault, empty for nothing."""
        if self.well:
            return self.reported
        what = self.advice if self.advice in ("ABORT", "REALIGN") else self.status
        return f"{what}: {self.why}" if self.why else what


@dataclass(frozen=True, slots=True)
class Judged:
    """What came of a fault in one run.

    noticed_ms: after its onset; None where nothing was shown of it
    covered: whether no estimate was wrong from `within_s` on until the fault was over and noticed to be
    shown: the words that were shown most while it lasted, or else what was reported
    recovered_ms: after its end, or after its onset where it stays; None where it did not until the run's end
    sigma_before_mm, sigma_most_mm: spread of the target before, and the largest while it lasted
    go_shown_while_faulty: moments at which GO was shown on an estimate that was wrong, or older than STALE_S, or of a
        needle that would miss, from `within_s` after the onset on; go: all at which it was shown, from the onset on
    ended: how the program ended where one of its own ran, else empty
    lacks_s: of what was shown before its end, or before its disk was full, how much its tables or its recording lack
        [s]; all where they cannot be read, None where there are none
    """

    fault: str
    seed: int
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
    """A fault, and how it is made and judged.

    name: as the table has it; what: in a few words; lasts_s: from ONSET_S on [s], inf for one that stays
    within_s: when it has to be noticed, at the latest, or covered [s]
    alone: whether its run takes place in real time, so that nothing else may be at work on the machine
    """

    name: str
    what: str
    lasts_s: float = LASTS_S
    within_s: float = FRAME_S
    alone: ClassVar[bool] = False

    @abstractmethod
    def judged(self, seed: int, folder: Path) -> Judged:
        """What came of it in a run; folder: one that exists, for what the run writes."""


@contextmanager
def quiet_folder() -> Iterator[Path]:
    """A folder for what a run writes, gone afterwards; meanwhile nothing is logged."""
    level = LOG.level
    LOG.setLevel(logging.CRITICAL)
    try:
        with tempfile.TemporaryDirectory() as folder:
            yield Path(folder)
    finally:
        LOG.setLevel(level)


def is_wrong(mean: Floats, cov: Floats | None, truth_m: Floats) -> bool:
    """Whether the truth [m], (dim,), lies outside of the estimate's region of `WRONG`, and not only by a little."""
    if cov is None or not np.isfinite(mean).all() or not np.isfinite(cov).all():
        return True
    off = truth_m - mean
    if float(np.linalg.norm(off)) <= LEAST_M:
        return False
    return bool(off @ np.linalg.solve(cov, off) > chi2.ppf(WRONG, len(off)))


def verdict(fault: Fault, seed: int, moments: list[Moment], lasts_s: float) -> Judged:
    """What the moments of a run tell of a fault that began at ONSET_S and lasted so long [s], inf for one that stays.

    A run that shows nothing any more has ended before the last of them.
    """
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
        fault.name,
        seed,
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
    """The words that were shown most, whatever their figures, or else what was reported first."""
    ill = [one.words for one in moments if not one.well]
    if not ill:
        return next((one.reported for one in moments if one.reported), "")
    kinds = [re.sub(r"\d+(\.\d+)?", "0", words) for words in ill]
    (most, _), *_ = Counter(kinds).most_common(1)
    return ill[kinds.index(most)]


def _recovered(after: list[Moment], over_s: float, noticed_s: float | None) -> float | None:
    """When all is well for good after the fault was over, or was noticed where it stays [s]."""
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
