"""Contradictions between marks and model: an estimate may look healthy again after one, and be wrong.

After a spring was cut, or a mark was moved, the filter explains the marks by persistent forces: its innovations look
right, but the hidden target is elsewhere. Later frames do not show that. So the contradiction stays until somebody has
looked at tissue and marks and resets it.
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

    away_s: a mark that was not used for this long must come back where it is expected [s]; choice
    improbable: p-value of that frame's innovations below which it did not [1]; choice
    unbalanced: `Balance.probability` below which a persistent force contradicts the model [1]; choice
    together: likelihood ratio, one mark left out against all marks shifted alike, below which all marks moved together;
    0: not tested [1]; measured: at least 1e-4 in frames with pokes of 15 m/s²; at most 1e-7
        if marks accurate to 1 mm are shifted by 8 mm, 1e-11 by 10 mm
    """

    away_s: float = 0.2
    improbable: float = 1e-4
    unbalanced: float = 1e-4
    together: float = 1e-6


CONTRADICTION = ContradictionSettings()


class Contradiction:
    """Tests whether marks contradicted the model since `forget`, and how, by estimates in order of time.

    State: the reason, None while there is none; when each mark was last used [s].
    """

    def __init__(self, settings: ContradictionSettings = CONTRADICTION) -> None:
        self.reason: str | None = None
        self._settings = settings
        self._used_s: dict[str, float] = {}

    def forget(self) -> None:
        """Reset after somebody looked."""
        self.reason = None
        self._used_s.clear()

    def update(self, estimate: TargetEstimate, balance: Balance | None = None) -> None:
        """Update with the estimate of a frame, and the balance of its marks if there is one."""
        if self.reason is None:
            self.reason = self._why(estimate) or self._together(estimate) or self._force(balance)
        self._used_s |= dict.fromkeys(estimate.information_share, estimate.time_s)

    def _together(self, estimate: TargetEstimate) -> str | None:
        """Whether one shift of all marks explains innovations that are improbable, and no shift of a single mark does.

        Tissue does not move like that from one frame to the next; a moved camera looks like that. At a start it may,
        because its velocity is not known yet.
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
        if not back or estimate.nis is None:
            return None
        degrees = estimate.marks_used * len(estimate.mean)
        if chi2.sf(estimate.nis, degrees) >= self._settings.improbable:
            return None
        return f"mark {back[0]} came back elsewhere than expected: look at it, then reset"
