"""Disturbances: unknown forces, whose strengths switch with the modes of a Markov chain."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats
from estimators.tissue.settings import FilterSettings

SOLID, SOLID_S = (0.9, 9.0), 60.0
"""Strengths of a continuum's slow forces, relative to a poke [1], and correlation time [s]; choice. A continuum is
always loaded; at the greater strength its load changes faster."""


@dataclass(frozen=True, slots=True)
class Disturbances:
    """Prior of the unknown forces, as accelerations.

    Short forces act on each marked node independently. Slow forces, such as breathing or leaning, are a smooth field
    over the nodes on which forces may act, plus a uniform acceleration, as if gravity turned. The modes form a Markov
    chain: calm, pushed by slow forces of each strength, poked, led (nodes are pulled along). A continuum is neither
    poked nor led. All strengths except calm and white noise are multiplied by `raised`, for a stiff body.

    Attributes
    ----------
    calm_m_s2, poke_m_s2, led_m_s2 : float
        Standard deviation of a short force when calm or pushed, poked, and led [m/s²]; choice.
    slow_m_s2 : tuple of float
        Standard deviations of slow forces [m/s²], increasing; the first is that of all modes but pushed ones; choice.
    white : float
        Density of white noise on every free node [m/s²/sqrt(Hz)]; choice.
    short_s, slow_s : float
        Correlation times of short and slow forces [s]; choice.
    smooth_s : float
        Time over which a slow force of a continuum is smooth [s]; choice.
    each_s, lasting_s : tuple of float
        For a pushed, the poked and the led mode: mean time until it follows a weaker mode; mean time [s] until each
        weaker mode follows a pushed one, and the first pushed mode the poked or the led mode; choice.
    smooth : float
        Correlation length of slow forces, relative to the body's extent [1]; choice.
    is_solid : bool
        Whether the body is a continuum.
    bent : float
        Share of its extent by which a poke bends a stiff body at rest [1]; choice.
    """

    calm_m_s2: float = 0.01
    poke_m_s2: float = 5.0
    led_m_s2: float = 50.0
    slow_m_s2: tuple[float, ...] = (0.0, 0.5, 2.0)
    white: float = 0.02
    short_s: float = 0.2
    slow_s: float = 1.5
    smooth_s: float = 0.3
    each_s: tuple[float, float, float] = (30.0, 20.0, 60.0)
    lasting_s: tuple[float, float, float] = (30.0, 0.3, 1.0)
    smooth: float = 0.25
    is_solid: bool = False
    bent: float = 0.1

    @classmethod
    def of(cls, settings: FilterSettings, *, solid: bool = False) -> Disturbances:
        """The prior with strength and duration of pokes from the settings. solid: whether the body is a continuum."""
        pokes = cls(poke_m_s2=settings.poked.poke, short_s=settings.poked.lasting_s)
        by_poke = SOLID[0] * pokes.poke_m_s2, SOLID[1] * pokes.poke_m_s2
        return replace(pokes, calm_m_s2=0.0, slow_m_s2=by_poke, slow_s=SOLID_S, is_solid=True) if solid else pokes

    def raised(self, returning_m_s2: float, least: float = 1.0) -> float:
        """Factor on the strengths for a stiff body [1], at least `least`.

        returning_m_s2: acceleration with which the body returns when it is bent by its extent
        """
        return max(least, self.bent * returning_m_s2 / self.poke_m_s2)

    def fading_s(self, are_slow: NDArray[np.bool_]) -> Floats:
        """Correlation time of each force (n_f,) [s], depending on whether it is slow."""
        return np.where(are_slow, self.slow_s, self.short_s)

    def by_mode(self, raised: float) -> list[tuple[float, float, float, float]]:
        """Strengths of white, short, led and slow forces in each mode; raised: factor on all except white and calm."""
        slow, poke, led = raised * np.array(self.slow_m_s2), raised * self.poke_m_s2, raised * self.led_m_s2
        short = [self.calm_m_s2] * len(slow) + ([] if self.is_solid else [poke, led])
        slow = np.append(slow, [slow[0]] * (len(short) - len(slow)))
        return [(self.white, one, max(one, led), float(other)) for one, other in zip(short, slow, strict=True)]

    def strongest(self, raised: float) -> dict[str, float]:
        """Largest strength of each source by name [m/s²], over all modes but led."""
        modes = self.by_mode(raised)[: None if self.is_solid else -1]
        return dict(zip(("white", "short", "led", "slow"), np.max(modes, axis=0), strict=True))

    @property
    def calm_modes(self) -> NDArray[np.bool_]:
        """Whether each mode is without a short force, (n_modes,)."""
        n = len(self.slow_m_s2)
        return np.arange(n if self.is_solid else n + 2) < n

    @property
    def rates(self) -> Floats:
        """Transition rates between the modes [1/s], (n_modes, n_modes)."""
        n, n_slow = len(self.calm_modes), len(self.slow_m_s2)
        rates = np.zeros((n, n))
        for mode in range(1, n):
            kind = max(0, mode - n_slow + 1)
            rates[:mode, mode] = 1.0 / self.each_s[kind]
            rates[mode, min(1, n_slow - 1) if kind else slice(mode)] = 1.0 / self.lasting_s[kind]
        return np.asarray(rates - np.diag(rates.sum(axis=1)))
