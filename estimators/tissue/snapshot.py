"""The state of a filter at one time, for going back to it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from estimators.arrays import Floats
from estimators.filters.mixture import InteractingMixture
from estimators.tissue.health import Health


@dataclass(frozen=True, slots=True, eq=False)
class MixtureState:
    """The state of a bank of filters.

    moments: mean (n,) and covariance (n, n) of each mode; columns (n_modes, n, n_columns); mu: probabilities (n_modes,)
    mean, cov: of the whole mixture, (n,), (n, n); repairs: counts of numerical repairs
    """

    moments: tuple[tuple[Floats, Floats], ...]
    columns: Floats
    mu: Floats
    mean: Floats
    cov: Floats
    repairs: Counter[str]


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """The whole state of a `TissueFilter` at one time.

    time_s, updated_s, refuted_s: of the state, of the last update, of the last divergence [s], None before the first
    seen_s, outlying_s: by node, when its mark was last taken in, and since when it has been beyond the gate [s]
    rejected: counts by node or `fix`; open_loop_cov: state of the open loop's covariance
    marks_scale: factor on the marks' variances and the information behind it; log_likelihood: of the last marks
    """

    time_s: float | None
    mixture: MixtureState
    health: Health
    seen_s: dict[str, float]
    outlying_s: dict[str, float]
    rejected: Counter[str]
    updated_s: float | None
    refuted_s: float | None
    open_loop_cov: Floats
    marks_scale: tuple[float, float]
    log_likelihood: float


def mixture_state(mixture: InteractingMixture) -> MixtureState:
    """The state of a mixture, for `restore_mixture`; arrays are shared, for updates replace and never write them."""
    moments = tuple((f.x, f.P) for f in mixture.filters)
    return MixtureState(moments, mixture.columns, mixture.mu, mixture.x, mixture.P, mixture.repairs.copy())


def restore_mixture(mixture: InteractingMixture, state: MixtureState) -> None:
    """Set a mixture back to a state that it had."""
    for f, (x, P) in zip(mixture.filters, state.moments, strict=True):
        f.x, f.P = x, P
    mixture.columns, mixture.mu, mixture.x, mixture.P = state.columns, state.mu, state.mean, state.cov
    mixture.repairs = state.repairs.copy()


@contextmanager
def unchanged(mixture: InteractingMixture) -> Iterator[MixtureState]:
    """The state of a mixture now, to which it is set back at the end."""
    now = mixture_state(mixture)
    try:
        yield now
    finally:
        restore_mixture(mixture, now)
