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

    Short forces act on each marked node independently; a node is calm, poked or led (pulled along for longer). A poke
    pushes few nodes, so with many marks short forces are weaker, and the sum of their variances is limited. Slow
    forces, such as breathing or leaning, are a smooth field over the nodes on which forces may act, plus a uniform
    acceleration, as if gravity turned. Short and slow forces each follow a Markov chain; a mode is a pair of their
    states. A continuum has only slow forces. For a stiff body, `raised` multiplies all strengths but calm and white.

    Attributes
    ----------
    calm_m_s2, poke_m_s2, led_m_s2 : float
        Standard deviation of a short force in each state [m/s²]; choice.
    slow_m_s2 : tuple of float
        Standard deviation of a slow force in each of its states [m/s²], increasing; choice.
    white : float
        Density of white noise on every free node [m/s²/sqrt(Hz)]; choice.
    short_s, slow_s : float
        Correlation times of short and slow forces [s]; choice.
    smooth_s : float
        Time over which a slow force of a continuum is smooth [s]; choice.
    calm_s, poked_s, led_each_s, led_s : float
        Mean durations of calm and of a poke, mean time between periods of being led, mean duration of such a period
        [s]; choice.
    rise_s, fall_s : float
        Mean time until a slow force changes to a stronger state, and to a weaker state [s]; choice.
    smooth : float
        Correlation length of slow forces, relative to the body's extent [1]; choice.
    n_short : int
        Number of states of short forces: three; 1 for a continuum.
    n_poked : int
        Largest sum of the variances of short forces, in variances of one force at full strength; choice.
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
    calm_s: float = 20.0
    poked_s: float = 0.3
    led_each_s: float = 120.0
    led_s: float = 1.0
    rise_s: float = 120.0
    fall_s: float = 30.0
    smooth: float = 0.25
    n_short: int = 3
    n_poked: int = 3
    bent: float = 0.1

    @classmethod
    def of(cls, settings: FilterSettings, *, solid: bool = False) -> Disturbances:
        """The prior with strength and duration of pokes from the settings. solid: whether the body is a continuum."""
        pokes = cls(poke_m_s2=settings.poked.poke, short_s=settings.poked.lasting_s)
        by_poke = tuple(share * pokes.poke_m_s2 for share in SOLID)
        slow = replace(pokes, calm_m_s2=0.0, slow_m_s2=by_poke, slow_s=SOLID_S, rise_s=pokes.fall_s, n_short=1)
        return slow if solid else pokes

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
        calm, poke, led = self.short_m_s2
        shorts = (calm, raised * poke, raised * led)[: self.n_short]
        return [
            (self.white, short, max(short, raised * led), raised * slow) for slow in self.slow_m_s2 for short in shorts
        ]

    @property
    def strongest_mode(self) -> int:
        """Index of the mode with the strongest slow force and, for networks, a poke."""
        return len(self.calm_modes) - max(1, self.n_short - 1)

    def strongest(self, raised: float) -> dict[str, float]:
        """Strength of each source by name, in the strongest mode [m/s²]."""
        return dict(zip(("white", "short", "led", "slow"), self.by_mode(raised)[self.strongest_mode], strict=True))

    @property
    def short_m_s2(self) -> tuple[float, float, float]:
        """Strengths of short forces in the states calm, poked and led [m/s²]."""
        return self.calm_m_s2, self.poke_m_s2, self.led_m_s2

    @property
    def calm_modes(self) -> NDArray[np.bool_]:
        """Whether each mode is without a short force, (n_modes,)."""
        return np.tile(np.arange(self.n_short) == 0, len(self.slow_m_s2))

    @property
    def rates(self) -> Floats:
        """Transition rates between the modes [1/s], (n_modes, n_modes); the modes of one slow state are adjacent."""
        short = np.zeros((3, 3))
        short[0, 1], short[1, 0] = 1.0 / self.calm_s, 1.0 / self.poked_s
        short[:2, 2], short[2, 1] = 1.0 / self.led_each_s, 1.0 / self.led_s
        n = len(self.slow_m_s2)
        slow = np.triu(np.full((n, n), 1.0 / self.rise_s), 1) + np.tril(np.full((n, n), 1.0 / self.fall_s), -1)
        rates = np.kron(np.eye(n), short[: self.n_short, : self.n_short]) + np.kron(slow, np.eye(self.n_short))
        return np.asarray(rates - np.diag(rates.sum(axis=1)), dtype=float)
