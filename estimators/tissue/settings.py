"""What the filter of the tissue assumes about forces it cannot see, and where its guards stand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estimators.arrays import Floats
from estimators.tissue.process_model import FixBias, ForceMode

N_QUIET = 2
"""Modes in which nobody pokes: calm, and between; they come first."""


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """What the filter assumes about forces it cannot see; every figure chosen, see `docs/decisions.md`.

    Three modes: calm, where nobody pokes; between, where somebody does but not now; poked. The first two believe the
    same of the force and differ in how soon a poke may come, so that the filter learns whether pokes are about.

    calm_s, between_s, poked_s: how long each lasts on average [s]
    calm_share: part of the pokes after which there is calm
    settle_s: the filter starts as unsure as the tissue would be after unseen pokes of this duration [s]
    start_s: marks are taken in for so long before the target counts as tracked [s]
    startle_m_s, startle_s: a blow may change a node's velocity by this at once [m/s] and carry it on for so long [s]
        before the springs have it back; marks are looked for that far off
    gate: squared Mahalanobis distance beyond which a mark is refused: chi-square, 2 degrees, one in 100,000
    stubborn_s: a mark that stays beyond the gate for longer than this is the tissue and not an outlier [s]
    lost_s: without any mark for longer than this the target counts as lost [s]
    test_s: innovations of this time [s] are tested together for divergence
    test_sigmas: and may be improbable as a normal variable so many standard deviations out
    mix_s: the modes are mixed at least this often [s]
    one_of: so many marked nodes are poked one at a time, a poked mode for each; 0: any, all in one mode
    marks_bounds: between which factors the variances of the marks, as told, adapt to their innovations; (1, 1): not
    fix_bias: what fixes of the target are off by together; None where none are to come
    """

    quiet: ForceMode = ForceMode(white=0.043, poke=0.043, lasting_s=0.05)
    poked: ForceMode = ForceMode(white=0.043, poke=5.0, lasting_s=0.2)
    calm_s: float = 100.0
    between_s: float = 1.5
    poked_s: float = 0.3
    calm_share: float = 0.05
    settle_s: float = 1.0
    start_s: float = 0.1
    impulse_m_s: float = 1.0
    impulse_s: float = 0.05
    gate: float = 23.03
    outlier_s: float = 0.1
    lost_s: float = 1.0
    test_s: float = 0.25
    test_sigmas: float = 10.0
    mix_s: float = 1.0 / 30.0
    one_of: int = 0
    marks_bounds: tuple[float, float] = (1.0, 1.0)
    fix_bias: FixBias | None = None

    @property
    def modes(self) -> tuple[ForceMode, ...]:
        """What calm, between and poked believe of the force; poked once, or once for each of `one_of` marked nodes."""
        if not self.one_of:
            return (self.quiet, self.quiet, self.poked)
        one = (replace(self.poked, only=k, others=self.quiet) for k in range(self.one_of))
        return (self.quiet, self.quiet, *one)

    @property
    def rates(self) -> Floats:
        """How often each mode turns into each other [1/s], (n_modes, n_modes), rows summing to zero."""
        n_poked = max(1, self.one_of)
        rates = np.zeros((N_QUIET + n_poked, N_QUIET + n_poked))
        rates[0, N_QUIET:] = 1.0 / self.calm_s / n_poked
        rates[1, N_QUIET:] = 1.0 / self.between_s / n_poked
        rates[N_QUIET:, 0] = self.calm_share / self.poked_s
        rates[N_QUIET:, 1] = (1.0 - self.calm_share) / self.poked_s
        return rates - np.diag(rates.sum(axis=1))

    def poked_share(self, odds: Floats) -> float:
        """Probability that somebody pokes, of the odds of the modes, (n_modes,)."""
        return float(np.sum(odds[N_QUIET:]))


def stationary(rates: Floats) -> Floats:
    """Long-run probability of each mode, (n,), of a chain with these rates [1/s], (n, n)."""
    n = len(rates)
    balance = np.vstack([rates.T, np.ones(n)])
    return np.linalg.lstsq(balance, np.r_[np.zeros(n), 1.0], rcond=None)[0]
