"""What the filter of the tissue assumes about forces it cannot see, and where its guards stand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estimators.arrays import Floats
from estimators.process.process_model import FixBias, ForceMode

N_QUIET = 2
"""Modes in which nobody pokes: calm, and between; they come first."""


QUIET_WHITE, POKED_WHITE = 0.3, 1.0
"""Acceleration noise of stiff or large bodies [m/s²/sqrt(Hz)]; measured: docs/decisions.md, "Stiff or large bodies"."""

LED = ForceMode(white=5.0, poke=50.0, lasting_s=0.1)
"""Forces on bodies that a hand leads, ten times a poke; measured: docs/decisions.md, "Stiff or large bodies"."""


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """What the filter assumes about forces that it cannot see, and where its gate and its tests stand.

    Three modes: calm, where nobody pokes; between, where somebody does but not now; poked. The first two have the same
    forces and differ in how soon a poke may come, so that the filter learns whether pokes are about.

    quiet, poked: forces without and with a poke; source: fields of `ForceMode`
    led: forces on nodes that a hand leads against any weight, as fast as it likes; None: nobody does; source: fields of
        `ForceMode`
    led_nodes: marked nodes that a hand is known to lead, all the time; then no other is led; source: the scene
    calm_s, between_s, poked_s: mean duration of each mode [s]; choice
    calm_share: share of the pokes after which there is calm [1]; choice
    impulse_m_s: a node's velocity may change by this at once [m/s]; choice
    impulse_s: for so long, then the springs have it back; marks are expected that far away [s]; choice
    gate: squared Mahalanobis distance beyond which a mark is rejected [1]; source: chi-square, 2 dof, 99.999 %
    confirm_s: marks that began, or that lie beyond the gate, are believed after so long [s]; choice
    lost_s: without marks for longer the target is LOST; a start is as uncertain as after unseen pokes for so long [s];
        choice
    forget_s: a prediction over more than this, or than lost_s, goes on from a start that much earlier [s]; measured:
        tests/estimators/tissue/test_gaps.py
    test_s: innovations of this time are tested together for divergence [s]; choice
    test_sigmas: standard deviations of a normal variable at which they have diverged [1]; choice
    inflation: factor on a start's covariance that is added to the state after a divergence [1]; choice
    model_only_share: share of the variance without marks above which the model alone speaks [1]; choice
    mix_s: the modes are mixed at least this often [s]; choice
    one_of: so many marked nodes are poked one at a time, a poked mode for each; 0: any, all in one mode [1]; source:
        the scene
    marks_bounds: factors on the variances of the marks between which they adapt to innovations; (1, 1): not [1];
        source: the scene
    fix_bias: the error that fixes of the target have in common; None where none are to come; source: the scene
    hidden_share: of a poke, what may act on each node without a mark of a stiff or large body [1]; choice
    strain_sd: strain by which the springs of a stiff or large body may be off, smoothly over it, where its constants
        come without uncertainty [1]; choice
    """

    quiet: ForceMode = ForceMode(white=0.043, poke=0.043, lasting_s=0.05)
    poked: ForceMode = ForceMode(white=0.043, poke=5.0, lasting_s=0.2)
    led: ForceMode | None = None
    led_nodes: tuple[str, ...] = ()
    calm_s: float = 100.0
    between_s: float = 1.5
    poked_s: float = 0.3
    calm_share: float = 0.05
    impulse_m_s: float = 1.0
    impulse_s: float = 0.05
    gate: float = 23.03
    confirm_s: float = 0.1
    lost_s: float = 1.0
    forget_s: float = 5.0
    test_s: float = 0.25
    test_sigmas: float = 10.0
    inflation: float = 10.0
    model_only_share: float = 0.5
    mix_s: float = 1.0 / 30.0
    one_of: int = 0
    marks_bounds: tuple[float, float] = (1.0, 1.0)
    fix_bias: FixBias | None = None
    hidden_share: float = 0.3
    strain_sd: float = 0.01

    @property
    def modes(self) -> tuple[ForceMode, ...]:
        """What calm, between, poked and led assume of the force; poked once, or once for each of `one_of` nodes."""
        led = (self.led,) if self.led is not None and not self.led_nodes else ()
        if not self.one_of:
            return (self.quiet, self.quiet, self.poked, *led)
        one = (replace(self.poked, only=k, others=self.quiet) for k in range(self.one_of))
        return (self.quiet, self.quiet, *one, *led)

    @property
    def leading(self) -> ForceMode:
        """Forces of a hand on nodes that it leads: `led`, or `LED` where that is None; units as in `ForceMode`."""
        return LED if self.led is None else self.led

    @property
    def rates(self) -> Floats:
        """How often each mode turns into each other [1/s], (n_modes, n_modes), rows summing to zero."""
        modes = self.modes
        n = len(modes)
        n_poked = n - N_QUIET
        rates = np.zeros((n, n))
        rates[0, N_QUIET:] = 1.0 / self.calm_s / n_poked
        rates[1, N_QUIET:] = 1.0 / self.between_s / n_poked
        rates[N_QUIET:, 0] = self.calm_share / self.poked_s
        rates[N_QUIET:, 1] = (1.0 - self.calm_share) / self.poked_s
        if modes[-1] is self.led:
            # a hand that leads is slow, then fast
            rates[N_QUIET:-1, -1] = 1.0 / self.poked_s
            rates[-1, N_QUIET:-1] = 1.0 / self.poked_s / (n_poked - 1)
        return rates - np.diag(rates.sum(axis=1))

    def for_stiff_or_large(self) -> FilterSettings:
        """These settings for a stiff or large body: its nodes are led as well as poked, its model leaves more out."""
        quiet = replace(self.quiet, white=max(self.quiet.white, QUIET_WHITE))
        poked = replace(self.poked, white=max(self.poked.white, POKED_WHITE))
        return replace(self, quiet=quiet, poked=poked, led=self.leading)

    @property
    def least_odds(self) -> float:
        """Odds below which a shape of the tissue is given up: the likelihood of a mark at the gate, by the most."""
        return float(np.exp(-0.5 * self.gate))

    def poked_share(self, odds: Floats) -> float:
        """Probability that somebody pokes, of the odds of the modes, (n_branches n_modes,)."""
        return float(np.reshape(odds, (-1, len(self.modes)))[:, N_QUIET:].sum())


def stationary(rates: Floats) -> Floats:
    """Long-run probability of each mode, (n,), of a chain with these rates [1/s], (n, n)."""
    n = len(rates)
    balance = np.vstack([rates.T, np.ones(n)])
    return np.linalg.lstsq(balance, np.r_[np.zeros(n), 1.0], rcond=None)[0]
