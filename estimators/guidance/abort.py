"""Advice ABORT, for a needle that is inside the tissue but should not be inserted further."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimators.guidance.advice import Advice, Guidance
from estimators.guidance.needle import Insertion
from estimators.guidance.settings import AdviceSettings


class AbortWatch:
    """State machine that replaces advice by ABORT if a needle inside the tissue has to stop.

    Outside the tissue, the advice is not changed. Inside the tissue, there are three cases:

    1. The needle entered at most `AdviceSettings.abort_s` after a GO. ABORT replaces NO_GUIDANCE. ABORT also replaces
       WAIT and REALIGN if the hit probability is below `AdviceSettings.abort` times `AdviceSettings.go`.
    2. The needle entered without a GO, or later than `abort_s` after it. ABORT replaces any advice, then case 1 holds.
    3. The needle was inside at the first call. ABORT replaces NO_GUIDANCE. After a GO, case 1 applies.

    In cases 1 and 2, ABORT ends once the replaced advice has been GO for `abort_s`. In case 3, ABORT ends once the
    replaced advice has differed from NO_GUIDANCE for `abort_s`.

    State: whether the needle is inside, the case, the time of the last GO, the start of the advice that may end ABORT.
    """

    def __init__(self) -> None:
        self._inside: bool | None = None
        self._go_s = -np.inf
        self._followed_go = self._early = self._aborts = False
        self._well_s: float | None = None

    def checked(self, guided: Guidance, insertion: Insertion, settings: AdviceSettings, now_s: float) -> Guidance:
        """The guidance at now_s [s], with ABORT as its advice if the needle has to stop."""
        inside = insertion.depth_m > 0.0
        if not inside:
            self._inside, self._followed_go, self._early, self._aborts = False, False, False, False
            self._go_s = now_s if guided.advice is Advice.GO else self._go_s
            return guided
        if self._inside is False:
            self._followed_go = now_s - self._go_s <= settings.abort_s
            self._early = self._aborts = not self._followed_go
            self._well_s, self._go_s = None, -np.inf
        self._inside = True
        if not self._holds(guided, settings):
            self._aborts, self._well_s = True, None
            return self._abort(guided, f"it went in before GO; {guided.reason}" if self._early else guided.reason)
        if self._aborts:
            self._well_s = now_s if self._well_s is None else self._well_s
            well_for_s = now_s - self._well_s
            if well_for_s < settings.abort_s:
                return self._abort(guided, f"well again for {well_for_s:.1f} s, not yet for {settings.abort_s:g} s")
        self._early = self._aborts = False
        self._followed_go |= guided.advice is Advice.GO
        return guided

    def _holds(self, guided: Guidance, settings: AdviceSettings) -> bool:
        if guided.advice is Advice.NO_GUIDANCE:
            return False
        if guided.advice is Advice.GO:
            return True
        if not self._followed_go:
            return not self._early
        return not self._aborts and (guided.probability or 0.0) >= settings.abort * settings.go

    def _abort(self, guided: Guidance, reason: str) -> Guidance:
        awaited = "GO" if self._followed_go or self._early else "new advice"
        return replace(guided, advice=Advice.ABORT, reason=f"stop: draw back, or wait for {awaited}; {reason}")
