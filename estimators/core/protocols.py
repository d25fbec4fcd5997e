"""Protocols of a process model and of an observation, the only interfaces that the filter uses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from estimators.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Transition:
    """A process model linearised about a reference state.

    Attributes
    ----------
    mean : (n,)
        Reference state after the transition, as `ProcessModel.moved` returns it.
    matrix : (n, n)
        Jacobian: derivative of the next state with respect to the previous state.
    noises : (n_noises, m, m)
        Noise covariance of the first n_noises sources, each at unit variance. They affect only the first m states.
    independent : (n_independent, n)
        Diagonal of the noise covariance of each remaining source, at unit variance. The noise of different states is
        independent.
    spread : (s, s), optional
        Covariance of the linearisation error in the first s states. All modes have the same error.
    """

    mean: Floats
    matrix: Floats
    noises: Floats
    independent: Floats = field(default_factory=lambda: np.empty((0, 0)))
    spread: Floats | None = None


class ProcessModel(Protocol):
    """Process model: motion of a state under noise, whose strength depends on the mode.

    Attributes
    ----------
    parts : mapping of str to slice
        Indices of each part of the state, by its name. If the filter has a `LevelPosterior`, one part is `discrepancy`.
    rates : (n_modes, n_modes)
        Transition rates between the modes [1/s]; rows sum to zero.
    tolerance : (n,)
        Largest accepted linearisation error of each state. If it is exceeded, the filter linearises again.
    """

    @property
    def parts(self) -> Mapping[str, slice]:
        """Indices of each part of the state, by its name."""

    @property
    def rates(self) -> Floats:
        """Transition rates of the modes [1/s], (n_modes, n_modes)."""

    @property
    def tolerance(self) -> Floats:
        """Largest accepted linearisation error of each state, (n,); infinite for states with linear motion."""

    def prior(self, level: float) -> tuple[Floats, Floats]:
        """Mean of the state, (n,), and its covariance in each mode, (n_modes, n, n), before any observation.

        level: standard deviation of the discrepancy (the error of the model), relative to the body's extent [1]
        """

    def variances(self, level: float) -> Floats:
        """Variance of each source of noise in each mode, (n_modes, n_sources). `Transition` gives the order of sources.

        level: standard deviation of the discrepancy (the error of the model), relative to the body's extent [1]
        """

    def moved(self, state: Floats, dt: float) -> Floats:
        """Next state (n,) after dt [s] without noise."""

    def linearize(self, state: Floats, dt: float, cov: Callable[[], Floats] | None = None) -> Transition:
        """Linearise the model over dt [s] about a state (n,).

        cov: returns the covariance of the most probable hypothesis, (n, n); only a model with sigma points calls it
        """

    def fresh(self, dt: float) -> float:
        """Share of the discrepancy's variance that arose in the last dt [s]; 0 without discrepancy."""


class Observation(Protocol):
    """Observation at the filter's time.

    Attributes
    ----------
    names : sequence of str
        Name of each block, such as the node of a mark; unique among the observations of a frame.
    value : (m,)
        Observed value, in any unit.
    cov : (m, m)
        Covariance of the value's error, positive definite. Errors of different observations are independent. The
        filter estimates a factor on the noise. If only a part of cov is noise, `noise_cov` states this part.
    blocks : sequence of slice
        Rows of each block in the value, in the order of `names`.
    """

    @property
    def names(self) -> Sequence[str]:
        """Name of each block."""

    @property
    def value(self) -> Floats:
        """Observed value, (m,)."""

    @property
    def cov(self) -> Floats:
        """Covariance of the value's error, (m, m)."""

    @property
    def blocks(self) -> Sequence[slice]:
        """Rows of each block in the value, in the order of `names`."""

    def linearize(self, state: Floats) -> tuple[Floats, Floats]:
        """Predicted value (m,) at a state (n,), and its derivative (m, n)."""
