"""What the filter of the tissue assumes about forces it cannot see, and where its guards stand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estimators.arrays import Floats
from estimators.process.process_model import FixBias, ForceMode

LED = ForceMode(white=1.0, poke=50.0, lasting_s=0.25)
"""Forces on bodies that a hand leads, ten times a poke; measured: docs/decisions.md, "Stiff or large bodies"."""


STIFF_LEVEL = 0.25
"""Factor on the variance of white noise below which that of a stiff or large body is not learnt [1]; measured:
docs/decisions.md, "Stiff or large bodies"."""


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """What the filter assumes about forces that it cannot see, and where its gate and its tests stand.

    Which forces act is told by a chain of states: calm, where nobody pokes; between, where somebody does but not now;
    poked; and apart from these struck, entered by the first blow, with a between and a poked of its own where blows are
    about. Of a stiff or large body a hand that leads is entered and remembered so, in place of blows. Calm and between
    have the same forces and differ in what comes next, so that the filter learns whether pokes are about. Where blows
    are about beliefs are as wide as blows are strong: a thousandth of that among the usual ones would have them explain
    what they cannot, so all states are modes. Of a stiff or large body states that act alike share one, for time.

    quiet, poked: forces without and with a poke; source: fields of `ForceMode`
    jolt: acceleration noise of a blow on each node that may be poked, beside the poke [m/s²/sqrt(Hz)]; choice
    led: forces on nodes that a hand leads against any weight, as fast as it likes, and which cover blows; None: nobody
        does; source: fields of `ForceMode`
    led_nodes: marked nodes that a hand is known to lead, all the time; then no other is led; source: the scene
    calm_s, between_s, poked_s: mean duration of calm, between pokes, or blows, where they are about, of a poke [s];
        choice
    unstruck_s: mean time until the first blow, or until a hand leads [s]; choice
    calm_share: share of the pokes, or blows, after which no more are about [1]; choice
    outlier_odds: of a mark to be anywhere in the tissue's reach [1]; choice
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
    mix_s: the modes are mixed about this often, at least once a frame; so long a blow lasts [s]; choice
    one_of: so many marked nodes are poked one at a time, a poked mode for each, none struck; 0: any, all in one mode
        [1]; source: the scene
    marks_bounds: factors on the variances of the marks between which they adapt to innovations; (1, 1): not [1];
        source: the scene
    white_bounds: factors on the variance of white noise between which it adapts to innovations; (1, 1): not [1];
        choice
    fix_bias: the error that fixes of the target have in common; None where none are to come; source: the scene
    hidden_share: of a poke, what may act on each node without a mark of a stiff or large body [1]; choice
    strain_sd: strain by which the springs of a stiff or large body may be off, smoothly over it, beside what is known
        of its constants [1]; choice
    hand_strain: by this share of its length a hand may bend a stiff or large body, whatever force that takes [1];
        measured: docs/decisions.md, "Stiff or large bodies"
    least_white: acceleration noise of a stiff or large body without and with a poke, at least; nought where the noise
        was tuned [m/s²/sqrt(Hz)]; measured: docs/decisions.md, "Stiff or large bodies"
    smooth: share of a stiff or large body's extent over which displacements that its springs do not explain are smooth
        [1]; choice
    led_inflation: by so much at most innovations that the filter did not expect inflate the covariance of a simulation
        by the same springs that is led along the marks, too; beyond it they tell of restarts that widened the filter's
        alone [1]; choice
    refuting_inflation: of a stiff or large body's covariance, beyond which it is INITIALISING and not TRACKING [1];
        choice
    remember_s: for so long innovations that exceed their covariance are remembered, at least [s]; choice
    remember_swings: so many of a stiff or large body's slowest oscillations they are remembered, where that is longer
        [1]; choice
    unified: whether `UnifiedFilter` is used, which knows other priors of its own; source: the scene
    sigma_points: whether the unified filter linearises the motion by sigma points, the unscented way, in place of its
        tangent; source: the caller
    discrepancy: standard deviation of what the model of the unified filter leaves out, by the body's extent; None: the
        marks choose it [1]; source: the scene
    """

    quiet: ForceMode = ForceMode(white=0.043, poke=0.043, lasting_s=0.05)
    poked: ForceMode = ForceMode(white=0.043, poke=5.0, lasting_s=0.2)
    jolt: float = 12.0
    led: ForceMode | None = None
    led_nodes: tuple[str, ...] = ()
    calm_s: float = 100.0
    between_s: float = 1.5
    poked_s: float = 0.3
    unstruck_s: float = 1e4
    calm_share: float = 0.05
    outlier_odds: float = 1e-4
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
    white_bounds: tuple[float, float] = (0.1, 16.0)
    fix_bias: FixBias | None = None
    hidden_share: float = 0.3
    strain_sd: float = 0.01
    hand_strain: float = 0.1
    least_white: tuple[float, float] = (0.3, 1.0)
    smooth: float = 0.3
    led_inflation: float = 8.0
    refuting_inflation: float = 4.0
    remember_s: float = 0.5
    remember_swings: float = 0.5
    unified: bool = False
    sigma_points: bool = False
    discrepancy: float | None = None

    @property
    def strikes(self) -> bool:
        """Whether blows have a mode: not of a body that is led, nor where nodes are known to be poked one at a time."""
        return self.led is None and not self.one_of

    @property
    def may_be_led(self) -> bool:
        """Whether a hand that leads has a mode: of a body that is led where nobody knows by which nodes."""
        return self.led is not None and not self.led_nodes

    @property
    def n_poked(self) -> int:
        """How many modes poked there are, before blows or a hand that leads."""
        return max(self.one_of, 1)

    @property
    def modes(self) -> tuple[ForceMode, ...]:
        """Forces calm, between, poked, these last two again among blows, and struck; poked once for each of `one_of`.

        Of a body that is led: quiet, poked, led.
        """
        one = tuple(replace(self.poked, only=k, others=self.quiet) for k in range(self.one_of))
        usual = (self.quiet, *(one or (self.poked,)))
        if self.strikes:
            return (self.quiet, *usual, *usual, replace(self.poked, jolt=self.jolt))
        if self.led is None:
            return (self.quiet, *usual)
        return (*usual, self.led) if self.may_be_led else usual

    @property
    def n_usual(self) -> int:
        """How many of the modes, the first, are not there for blows or a hand that leads."""
        return 3 if self.strikes else len(self.modes) - self.may_be_led

    @property
    def of_state(self) -> tuple[int, ...]:
        """Mode of each state: calm, between, poked; where blows, or a hand, are about between, poked, struck, or led.

        Of a body that is led those that act alike share a mode.
        """
        if self.led is None:
            return tuple(range(len(self.modes)))
        poked = range(1, 1 + self.n_poked)
        return (0, 0, *poked, 0, *poked, 1 + self.n_poked) if self.may_be_led else (0, 0, *poked)

    @property
    def quiet_modes(self) -> tuple[int, ...]:
        """Places of the modes in which nobody pokes."""
        return (0, 1, 3) if self.strikes else tuple(dict.fromkeys(self.of_state[:2]))

    @property
    def leading(self) -> ForceMode:
        """Forces of a hand on nodes that it leads: `led`, or `LED` where that is None; units as in `ForceMode`."""
        return LED if self.led is None else self.led

    @property
    def rates(self) -> Floats:
        """How often each state turns into each other [1/s], (n_states, n_states), rows summing to zero."""
        n_poked, n = self.n_poked, len(self.of_state)
        rates, last = np.zeros((n, n)), n - 1
        calm, between, poked = 0, 1, slice(2, 2 + n_poked)
        rates[calm, poked] = 1.0 / self.calm_s / n_poked
        rates[between, poked] = 1.0 / self.between_s / n_poked
        rates[poked, calm] = self.calm_share / self.poked_s
        rates[poked, between] = (1.0 - self.calm_share) / self.poked_s
        if self.strikes or self.may_be_led:
            own, own_poked = slice(poked.stop, last), slice(poked.stop + 1, last)
            rates[own, own] = rates[between : poked.stop, between : poked.stop]
            # blows are remembered as pokes are, a hand that leads until the next poke would be due
            forgotten = (self.calm_share if self.strikes else 1.0) / self.between_s
            rates[own, : poked.stop][range(1 + n_poked), range(between, poked.stop)] = forgotten
            rates[: poked.stop, last] = 1.0 / self.unstruck_s
            if self.strikes:
                rates[own, last] = 1.0 / self.between_s
                rates[last, poked.stop] = 1.0 / self.mix_s
            else:  # a hand that leads is slow, then fast
                rates[own_poked, last] = 1.0 / self.poked_s
                rates[last, own_poked] = 1.0 / self.poked_s / n_poked
        return rates - np.diag(rates.sum(axis=1))

    def for_stiff_or_large(self, restoring_m_s2: float = 0.0, slowest_s: float = 0.0) -> FilterSettings:
        """These settings for a stiff or large body: its nodes are led as well as poked, its model leaves more out.

        restoring_m_s2: acceleration with which it returns when bent by its own length [m/s²]
        slowest_s: period of its slowest oscillation [s]
        """
        quiet, poked = self.least_white
        harder = max(1.0, self.hand_strain * restoring_m_s2 / self.leading.poke)
        return replace(
            self,
            quiet=replace(self.quiet, white=max(self.quiet.white, quiet)),
            poked=replace(self.poked, white=max(self.poked.white, poked)),
            led=replace(self.leading, white=harder * self.leading.white, poke=harder * self.leading.poke),
            white_bounds=(max(self.white_bounds[0], STIFF_LEVEL), self.white_bounds[1]),
            remember_s=max(self.remember_s, self.remember_swings * slowest_s),
        )

    def poked_share(self, odds: Floats) -> float:
        """Probability that somebody pokes or strikes, of the odds of the modes, (n_modes,)."""
        return float(odds.sum() - odds[list(self.quiet_modes)].sum())

    def blow_share(self, odds: Floats) -> float:
        """Probability of a blow, of the odds of the modes, (n_modes,)."""
        return float(odds[-1]) if self.strikes else 0.0


def stationary(rates: Floats) -> Floats:
    """Long-run probability of each state, (n,), of a chain with these rates [1/s], (n, n)."""
    n = len(rates)
    balance = np.vstack([rates.T, np.ones(n)])
    return np.linalg.lstsq(balance, np.r_[np.zeros(n), 1.0], rcond=None)[0]
