"""Contradictions between marks and model, after which an estimate may look healthy but be wrong.

If a spring is cut or a mark is moved, the filter explains the measured positions by persistent forces. Its innovations
then become small again, although the estimate of the hidden target is wrong. Therefore a detected contradiction
persists until a person has checked tissue and marks, and resets the detector.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from estimators.consistency.static_balance import Balance
from estimators.tissue.estimate import Status, TargetEstimate


@dataclass(frozen=True, slots=True)
class ContradictionSettings:
    """Thresholds of the tests for a contradiction.

    away_s: if a mark was not used for longer than this time, it is tested when it is used again [s]; choice
    improbable: p-value below which innovations contradict the model [1]; choice
    unbalanced: p-value below which a persistent force contradicts the model, see `Balance.probability` [1]; choice
    together: a common shift of all marks is reported if the likelihood of one wrong mark is below this times the
        likelihood of the shift [1]; 0: no report. Measured: if a short force moves a node with 15 m/s², the ratio of
        both is at least 1e-4. If all marks, accurate to 1 mm, shift by 8 mm, the ratio is at most 1e-7
    """

    away_s: float = 0.2
    improbable: float = 1e-4
    unbalanced: float = 1e-4
    together: float = 1e-6


CONTRADICTION = ContradictionSettings()


class Contradiction:
    """Detector of a contradiction between marks and model. A contradiction persists until `forget` is called.

    State: reason, which is the contradiction in words or None; time of the last use of each mark [s].
    """

    def __init__(self, settings: ContradictionSettings = CONTRADICTION) -> None:
        self.reason: str | None = None
        self._settings = settings
        self._used_s: dict[str, float] = {}

    def forget(self) -> None:
        """Discard the contradiction, after a person has checked tissue and marks."""
        self.reason = None
        self._used_s.clear()

    def update(self, estimate: TargetEstimate, balance: Balance | None = None) -> None:
        """Update with the estimate of a frame; balance: static balance of its marks, or None to omit this test."""
        if self.reason is None:
            self.reason = self._why(estimate) or self._together(estimate) or self._force(balance)
        self._used_s |= dict.fromkeys(estimate.information_share, estimate.time_s)

    def _together(self, estimate: TargetEstimate) -> str | None:
        """The reason, in words, if a common shift of all marks explains the innovations, but one wrong mark does not.

        The result is otherwise None. It is also None during initialisation, when the tissue's velocity is unknown.
        """
        shift, settings = estimate.shift, self._settings
        if shift is None or estimate.status is Status.INITIALISING:
            return None
        if np.exp(0.5 * min(shift.nis - shift.nis_of_one, 0.0)) >= settings.together:
            return None
        if chi2.sf(shift.nis, (shift.n_marks - 1) * len(estimate.mean)) < settings.improbable:
            return None
        return "all marks moved together, as when the camera is moved: look, then reset"

    def _force(self, balance: Balance | None) -> str | None:
        if balance is None or balance.probability >= self._settings.unbalanced:
            return None
        most = int(np.argmax(np.linalg.norm(balance.force, axis=1)))
        return f"a persistent force on {balance.nodes[most]} is unexplained: look at tissue and marks, then reset"

    def _why(self, estimate: TargetEstimate) -> str | None:
        if estimate.status is Status.DIVERGED:
            return "the marks contradicted the model: look at tissue and marks, then reset"
        back = [
            node
            for node in estimate.information_share
            if estimate.time_s - self._used_s.get(node, estimate.time_s) > self._settings.away_s
        ]
        if not back or estimate.nis is None or not estimate.degrees:
            return None
        if chi2.sf(estimate.nis, estimate.degrees) >= self._settings.improbable:
            return None
        return f"mark {back[0]} came back elsewhere than expected: look at it, then reset"
