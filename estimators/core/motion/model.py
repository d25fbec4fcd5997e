"""Protocol of the motion of a body. The process model of the tissue uses this protocol."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from dynamics.elements import Span
from estimators.arrays import Floats

SOURCES = ("white", "short", "led", "slow", "discrepancy", "lasting")
"""Sources of noise, in their order in `Transition`. For the last two, the noise of different states is independent."""


class Along(NamedTuple):
    """Linearised motion over an interval. The state has n coordinates, n velocities and n_f forces.

    mean: state at the end, (2 n + n_f,)
    motion: derivative of coordinates and velocities at the end with respect to the state at the start, (2 n, 2 n + n_f)
    fading: decay factor of each force, (n_f,)
    noises: noise covariance from each of the first four `SOURCES` at unit variance, (4, 2 n + n_f, 2 n + n_f)
    by_constants: change of the coordinates and velocities at the end per standard deviation of each independent error
        of the model's constants, (2 n, n_constants)
    """

    mean: Floats
    motion: Floats
    fading: Floats
    noises: Floats
    by_constants: Floats


class Motion(Protocol):
    """Motion of a body under forces that decay.

    Attributes
    ----------
    is_linear : bool
        Whether the motion is linear, so that the linearisation in `along` is exact.
    """

    is_linear: bool

    @property
    def span(self) -> Span:
        """Map from the n coordinates to the positions of the free nodes."""

    @property
    def extent_m(self) -> float:
        """Extent of the body [m]."""

    @property
    def raised(self) -> float:
        """Factor on the strengths of the unknown forces [1]. It depends on the body's stiffness."""

    @property
    def driving(self) -> NDArray[np.int64]:
        """Index in `SOURCES` of the source that drives each force state, (n_f,)."""

    @property
    def fading_s(self) -> Floats:
        """Correlation time of each force state [s], (n_f,)."""

    @property
    def force_cov(self) -> Floats:
        """Covariance of the force states, (n_f, n_f), if each force has variance 1; see `ContinuumMotion`."""

    @property
    def by_force(self) -> Floats:
        """Displacement of free nodes per unit of a force state [s²], (n_full, n_f), beyond that of the coordinates."""

    def moved(self, state: Floats, dt: float) -> Floats:
        """State after dt [s] without noise: n coordinates, n velocities, n_f forces, (2 n + n_f,)."""

    def along(self, state: Floats, dt: float) -> Along:
        """Linearised motion from a state (2 n + n_f,) over dt [s]."""

    def pushed(self, state: Floats, dt: float, accelerations: Floats) -> Floats:
        """Change of coordinates and velocities over dt [s] by constant accelerations, (2 n, k).

        Each column of `accelerations` [m/s²], (n, k), gives one column of the result.
        """
