"""What a tissue's process model knows of how its body moves."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from dynamics.elements import Span
from estimators.arrays import Floats

SOURCES = ("white", "short", "led", "slow", "discrepancy", "lasting")
"""Sources of noise, in the order of `Transition`; the last two are independent in each state."""


class Along(NamedTuple):
    """A motion over some time, linearised.

    The state is n coordinates, n velocities and n_f forces. mean (2 n + n_f,): after it; motion (2 n, 2 n + n_f):
    derivative of coordinates and velocities by the state before; fading (n_f,): what is left of each force; noises (4,
    2 n + n_f, 2 n + n_f): of `SOURCES` but the last two, at unit variance; by_constants (2 n, n_constants): effect of
    each constant that is off by one standard deviation
    """

    mean: Floats
    motion: Floats
    fading: Floats
    noises: Floats
    by_constants: Floats


class Motion(Protocol):
    """How a body moves under forces that fade.

    Attributes
    ----------
    span : Span
        Places of the free nodes by the n coordinates.
    extent_m : float
        Of the body [m].
    raised : float
        Factor on the strengths of forces but calm ones, of a stiff body [1].
    driving : (n_f,) int
        Which of `SOURCES` drives each force.
    fading_s : (n_f,)
        Correlation time of each force [s].
    force_cov : (n_f, n_f)
        Covariance of the forces when their sources have variance 1.
    is_linear : bool
        Whether `along` is exact, however far from the state.
    """

    is_linear: bool

    @property
    def span(self) -> Span:
        """Places of the free nodes by the coordinates."""

    @property
    def extent_m(self) -> float:
        """Extent of the body [m]."""

    @property
    def raised(self) -> float:
        """Factor on the strengths of forces but calm ones [1]."""

    @property
    def driving(self) -> NDArray[np.int64]:
        """Which of `SOURCES` drives each force, (n_f,)."""

    @property
    def fading_s(self) -> Floats:
        """Correlation time of each force [s], (n_f,)."""

    @property
    def force_cov(self) -> Floats:
        """Covariance of the forces when their sources have variance 1, (n_f, n_f)."""

    def moved(self, state: Floats, dt: float) -> Floats:
        """Coordinates, velocities and forces (2 n + n_f,) after dt [s] without noise."""

    def along(self, state: Floats, dt: float) -> Along:
        """The motion from a state (2 n + n_f,) over dt [s]."""

    def pushed(self, state: Floats, dt: float, accelerations: Floats) -> Floats:
        """Coordinates and velocities after dt [s] from a state, (2 n, k), by constant accelerations (n, k) [m/s²]."""
