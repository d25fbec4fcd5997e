"""Disturbances: unknown forces, whose strengths change with the modes of a Markov chain."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats
from estimators.tissue.settings import FilterSettings

SOLID, SOLID_S = (0.1, 1.0), 10.0
"""Surface forces on a continuum: strengths relative to that of a poke [1], and correlation time [s]; choice."""

BODY, BODY_S = 0.1, (0.5, 0.45)
"""Force on the whole of a continuum, such as breathing: strength relative to that of a poke [1], and correlation times
[s] of the two states whose difference it is; choice."""


@dataclass(frozen=True, slots=True)
class Disturbances:
    """Prior of the unknown forces, stated as accelerations.

    Short forces act on each marked node independently. A Markov chain gives the state of all short forces: calm, poked
    (a brief push) or led (a node is dragged for longer). Slow forces, such as breathing, push the whole body. A second
    Markov chain gives their strength. A mode is a pair of a short and a slow state. On a continuum, slow forces act on
    the surface, and the short force, always in the state calm, acts on the whole body.

    Attributes
    ----------
    calm_m_s2, poke_m_s2, led_m_s2 : float
        Standard deviation of a short force in the states calm, poked and led [m/s²]; choice. On a continuum,
        `calm_m_s2` is that of the force on the whole body, before it is multiplied by `Motion.raised`.
    slow_m_s2 : tuple of float
        Standard deviation of a slow force in each of its states, in increasing order [m/s²]; choice.
    white : float
        Density of the white acceleration noise of each free node [m/s²/sqrt(Hz)]; choice.
    short_s, slow_s : float
        Correlation times of short and slow forces [s]; choice. On a continuum, `short_s` is that of the first state of
        the force on the whole body.
    smooth_s : float
        Correlation time of the second state of this force [s]; choice.
    calm_s, poked_s, led_s : float
        Mean duration of the states calm, poked and led [s]; choice.
    led_each_s : float
        Mean time from the state calm or poked until the state led begins [s]; choice.
    rise_s, fall_s : float
        Reciprocal of the transition rate of slow forces to each stronger and to each weaker state [s]; choice.
    smooth : float
        Correlation length of slow forces, relative to the body's extent [1]; choice.
    n_short : int
        Number of states of short forces: 3 for a network, 1 for a continuum.
    n_poked : int
        If there are more marked nodes than this number, pokes are weaker; choice.
    n_marked : int
        Number of marked nodes; `TissueProcess` sets it.
    bent : float
        Static displacement that a poke causes at least, relative to the body's extent [1]; choice.
    """

    calm_m_s2: float = 0.01
    poke_m_s2: float = 5.0
    led_m_s2: float = 50.0
    slow_m_s2: tuple[float, ...] = (0.0, 0.5, 2.0)
    white: float = 0.02
    short_s: float = 0.2
    slow_s: float = 1.5
    smooth_s: float = BODY_S[1]
    calm_s: float = 8.0
    poked_s: float = 0.3
    led_each_s: float = 120.0
    led_s: float = 1.0
    rise_s: float = 240.0
    fall_s: float = 30.0
    smooth: float = 0.25
    n_short: int = 3
    n_poked: int = 3
    n_marked: int = 1
    bent: float = 0.1

    @classmethod
    def of(cls, settings: FilterSettings, *, solid: bool = False) -> Disturbances:
        """Make the prior from the settings of the filter. `solid` states whether the body is a continuum."""
        pokes = cls(poke_m_s2=settings.poked.poke, short_s=settings.poked.lasting_s)
        by_poke = tuple(share * pokes.poke_m_s2 for share in SOLID)
        on_body = replace(pokes, calm_m_s2=BODY * pokes.poke_m_s2, short_s=BODY_S[0], n_short=1)
        return replace(on_body, slow_m_s2=by_poke, slow_s=SOLID_S, rise_s=pokes.fall_s) if solid else pokes

    def raised(self, returning_m_s2: float, least: float = 1.0) -> float:
        """Factor on strengths of pokes, dragging, slow forces and all forces on a continuum [1]; large if stiff.

        returning_m_s2: acceleration by elastic forces at a displacement that equals the body's extent [m/s²]
        least: smallest factor
        """
        return max(least, self.bent * returning_m_s2 / self.poke_m_s2)

    def by_mode(self, raised: float) -> list[tuple[float, float, float, float]]:
        """Strengths of white [m/s²/sqrt(Hz)], short, led and slow [m/s²] in each mode; raised: see `Motion.raised`."""
        calm, poke, led = self.short_m_s2
        shorts = (calm if self.n_short > 1 else raised * calm, raised * poke, raised * led)[: self.n_short]
        return [
            (self.white, short, max(short, raised * led), raised * slow) for slow in self.slow_m_s2 for short in shorts
        ]

    @property
    def strongest_mode(self) -> int:
        """Index of the mode with the strongest slow force. In a network, short forces are in the state poked."""
        return len(self.calm_modes) - max(1, self.n_short - 1)

    def strongest(self, raised: float) -> dict[str, float]:
        """Strengths in `strongest_mode` by source [m/s²], white [m/s²/sqrt(Hz)]; raised: see `Motion.raised`."""
        return dict(zip(("white", "short", "led", "slow"), self.by_mode(raised)[self.strongest_mode], strict=True))

    @property
    def short_m_s2(self) -> tuple[float, float, float]:
        """Strengths of short forces in the states calm, poked and led [m/s²]."""
        share = min(1.0, self.n_poked / self.n_marked) ** 0.5
        return self.calm_m_s2, share * self.poke_m_s2, self.led_m_s2

    @property
    def calm_modes(self) -> NDArray[np.bool_]:
        """Whether the state of the short forces is calm in each mode, (n_modes,)."""
        return np.tile(np.arange(self.n_short) == 0, len(self.slow_m_s2))

    @property
    def rates(self) -> Floats:
        """Transition rates between modes [1/s], (n_modes, n_modes). Modes with stronger slow forces come later."""
        short = np.zeros((3, 3))
        short[0, 1], short[1, 0] = 1.0 / self.calm_s, 1.0 / self.poked_s
        short[:2, 2], short[2, 1] = 1.0 / self.led_each_s, 1.0 / self.led_s
        n = len(self.slow_m_s2)
        slow = np.triu(np.full((n, n), 1.0 / self.rise_s), 1) + np.tril(np.full((n, n), 1.0 / self.fall_s), -1)
        rates = np.kron(np.eye(n), short[: self.n_short, : self.n_short]) + np.kron(slow, np.eye(self.n_short))
        return np.asarray(rates - np.diag(rates.sum(axis=1)), dtype=float)
