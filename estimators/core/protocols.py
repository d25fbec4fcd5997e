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
        Next state from the reference state, as `ProcessModel.moved` returns it.
    matrix : (n, n)
        Jacobian: derivative of the next state with respect to the previous state.
    noises : (n_noises, m, m)
        Covariance of the noise from each source at unit variance. The noise affects only the first m states.
    independent : (n_independent, n)
        For each further source at unit variance, variance of its noise in each state. Its noise is independent between
        states.
    spread : (s, s), optional
        Covariance of the linearisation error in the first s states, the same in all modes.
    """

    mean: Floats
    matrix: Floats
    noises: Floats
    independent: Floats = field(default_factory=lambda: np.empty((0, 0)))
    spread: Floats | None = None


class ProcessModel(Protocol):
    """Process model: how a state moves under each of several modes of noise.

    Attributes
    ----------
    parts : mapping of str to slice
        Parts of the state by name. If the filter has a `LevelPosterior`, one part is named `discrepancy`.
    rates : (n_modes, n_modes)
        Transition rates between the modes [1/s]; rows sum to zero.
    tolerance : (n,)
        Error of the linearisation above which the filter linearises again, for each state.
    """

    @property
    def parts(self) -> Mapping[str, slice]:
        """Parts of the state by name."""

    @property
    def rates(self) -> Floats:
        """Transition rates of the modes [1/s], (n_modes, n_modes)."""

    @property
    def tolerance(self) -> Floats:
        """Linearisation error above which the filter linearises again, (n,); infinite where the model is linear."""

    def prior(self, level: float) -> tuple[Floats, Floats]:
        """Mean (n,) and covariance in each mode (n_modes, n, n) before any observation.

        level: level of the discrepancy
        """

    def variances(self, level: float) -> Floats:
        """Variance of each source of noise in each mode, (n_modes, n_sources); those of `Transition.noises` come first.

        level: level of the discrepancy
        """

    def moved(self, state: Floats, dt: float) -> Floats:
        """Next state (n,) after dt [s] without noise."""

    def linearize(self, state: Floats, dt: float, cov: Callable[[], Floats] | None = None) -> Transition:
        """The model over dt [s], linearised about a state (n,).

        cov: function that returns the covariance of the most probable hypothesis, (n, n), for sigma points
        """

    def fresh(self, dt: float) -> float:
        """Share of the discrepancy's variance that is independent of its value dt [s] ago; 0 without discrepancy."""


class Observation(Protocol):
    """Observation at the filter's time.

    Attributes
    ----------
    names : sequence of str
        Name of each block, such as the node of a mark; unique among all observations of a time.
    value : (m,)
        Observed value, in any unit.
    cov : (m, m)
        Covariance of the value's error, positive definite; errors of different observations are independent. The
        optional attribute `noise_cov` is the part of it whose level the filter estimates; default: all of it.
    blocks : sequence of slice
        Rows of each name.
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
        """Rows of each name."""

    def linearize(self, state: Floats) -> tuple[Floats, Floats]:
        """Predicted value (m,) at a state (n,), and its derivative (m, n)."""
