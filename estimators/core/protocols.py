"""The protocols of a process model and of an observation: all that the filter knows of either."""

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
        The state that follows the reference, as `ProcessModel.moved`.
    matrix : (n, n)
        Derivative of the state that follows by the state before.
    noises : (n_noises, m, m)
        Covariance of the process noise of each source at unit variance, in the first m states, n or fewer.
    independent : (n_independent, n)
        Variances of further sources, whose noise is independent in each state, at unit variance.
    spread : (s, s), optional
        Covariance of noise in the first s states that is the same in all modes: what is left over by a linearisation.
    """

    mean: Floats
    matrix: Floats
    noises: Floats
    independent: Floats = field(default_factory=lambda: np.empty((0, 0)))
    spread: Floats | None = None


class ProcessModel(Protocol):
    """How a state moves, under each of several modes of noise.

    Attributes
    ----------
    parts : mapping of str to slice
        The parts of the state by name; with a `LevelPosterior` one is named discrepancy.
    rates : (n_modes, n_modes)
        How often each mode turns into each other [1/s]; rows sum to zero.
    tolerance : (n,)
        Difference of each state that matters: beyond it the filter linearises again.
    """

    @property
    def parts(self) -> Mapping[str, slice]:
        """Parts of the state, by name."""

    @property
    def rates(self) -> Floats:
        """Transition rates of the modes [1/s], (n_modes, n_modes)."""

    @property
    def tolerance(self) -> Floats:
        """Difference of each state that matters, (n,); infinite of those in which the model is linear."""

    def prior(self, level: float) -> tuple[Floats, Floats]:
        """Mean (n,) and covariance under each mode (n_modes, n, n), before anything is observed.

        level: of the discrepancy
        """

    def variances(self, level: float) -> Floats:
        """Variance of each source of noise in each mode, (n_modes, n_sources), those of `Transition.noises` first.

        level: of the discrepancy
        """

    def moved(self, state: Floats, dt: float) -> Floats:
        """The state (n,) that follows after dt [s] without noise."""

    def linearize(self, state: Floats, dt: float, cov: Callable[[], Floats] | None = None) -> Transition:
        """The model over dt [s], linearised about a state (n,).

        cov: returns the covariance of the most probable hypothesis before, (n, n), for models that move sigma points
        """

    def fresh(self, dt: float) -> float:
        """Share of the discrepancy's variance that is new after dt [s]; 0 where there is none."""


class Observation(Protocol):
    """Something that was observed at the filter's time.

    Attributes
    ----------
    names : sequence of str
        What each block of it is about, such as the node of a mark; each name once among all observations of a time.
    value : (m,)
        In units of its own.
    cov : (m, m)
        Of the error of the value, positive definite; errors of different observations are independent.
    blocks : sequence of slice
        Rows of each name.
    """

    @property
    def names(self) -> Sequence[str]:
        """What each block is about."""

    @property
    def value(self) -> Floats:
        """What was observed, (m,)."""

    @property
    def cov(self) -> Floats:
        """Covariance of its error, (m, m)."""

    @property
    def blocks(self) -> Sequence[slice]:
        """Rows of each name."""

    def linearize(self, state: Floats) -> tuple[Floats, Floats]:
        """Predicted value (m,) at a state (n,), and its derivative (m, n)."""
