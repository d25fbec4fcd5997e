"""The state of a filter at one time, for going back to it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

from estimators.arrays import Floats
from estimators.filters.measurement import CommonErrors
from estimators.filters.mixture import InteractingMixture
from estimators.filters.motion import Cycle
from estimators.filters.noise_level import LevelState
from estimators.threads import one_blas_thread
from estimators.tissue.gate import Outlying
from estimators.tissue.health import Health
from estimators.tissue.model_error import Shown


@dataclass(frozen=True, slots=True, eq=False)
class MixtureState:
    """The state of a bank of filters.

    moments: mean (n,) and covariance (n, n) of each mode; columns (n_modes, n, n_columns)
    odds: of the states of the chain, (n_states,)
    mean, cov: of the whole mixture, (n,), (n, n); repairs: counts of numerical repairs
    cycle: the prediction that no update has followed yet, of a linearised motion
    common_errors: what innovations told of the columns' directions
    level: of the process noise; None where it is not learnt
    """

    moments: tuple[tuple[Floats, Floats], ...]
    columns: Floats
    odds: Floats
    mean: Floats
    cov: Floats
    repairs: Counter[str]
    cycle: Cycle | None
    common_errors: CommonErrors
    level: LevelState | None


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """The whole state of a `TissueFilter` at one time.

    time_s, updated_s: of the state, of the last update [s], None before the first
    before_s, refuted_s: of the frame before that of the last update, of the last divergence [s], -inf for none
    seen_s, outlying: by node, when its mark was last taken in [s], and what was seen of it beyond the gate
    rejected: counts by node or `fix`; open_loop_cov: state of the open loop's covariance
    marks_scale: factor on the marks' variances and the information behind it; log_likelihood: of the last marks
    shown: of the model's error
    """

    time_s: float | None
    mixture: MixtureState
    health: Health
    seen_s: dict[str, float]
    outlying: dict[str, Outlying]
    rejected: Counter[str]
    updated_s: float | None
    before_s: float
    refuted_s: float
    open_loop_cov: Floats
    marks_scale: tuple[float, float]
    log_likelihood: float
    shown: Shown

    def without_marks(self) -> Snapshot:
        """The same before any mark was seen."""
        return replace(self, health=Health())


def mixture_state(mixture: InteractingMixture) -> MixtureState:
    """The state of a mixture, for `restore_mixture`; arrays are shared, for updates replace and never write them."""
    moments = tuple((f.x, f.P) for f in mixture.filters)
    return MixtureState(
        moments,
        mixture.columns,
        mixture.chain.odds,
        mixture.x,
        mixture.P,
        mixture.repairs.copy(),
        mixture.cycle,
        mixture.common_errors,
        None if mixture.level is None else mixture.level.state,
    )


def restore_mixture(mixture: InteractingMixture, state: MixtureState) -> None:
    """Set a mixture back to a state that it had."""
    mixture.chain.odds = state.odds
    for f, (x, P) in zip(mixture.filters, state.moments, strict=True):
        f.x, f.P = x, P
    mixture.columns, mixture.x, mixture.P = state.columns, state.mean, state.cov
    mixture.repairs, mixture.cycle = state.repairs.copy(), state.cycle
    mixture.common_errors = state.common_errors
    if mixture.level is not None and state.level is not None:
        mixture.level.resume(state.level)


class Restorable(Protocol):
    """What can be set back to a state that it had."""

    def snapshot(self) -> Any:
        """The whole state now."""

    def restore(self, then: Any) -> None:
        """Set the state back to a snapshot."""


Owner = TypeVar("Owner", bound=Restorable)
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def all_or_nothing(
    method: Callable[Concatenate[Owner, Arguments], Result],
) -> Callable[Concatenate[Owner, Arguments], Result]:
    """The method, in one thread, but a call of it that raises leaves the state as it was."""

    @wraps(method)
    def kept(self: Owner, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        before = self.snapshot()
        try:
            with one_blas_thread():
                return method(self, *args, **kwargs)
        except BaseException:
            self.restore(before)
            raise

    return kept


@contextmanager
def unchanged(mixture: InteractingMixture) -> Iterator[MixtureState]:
    """The state of a mixture now, to which it is set back at the end."""
    now = mixture_state(mixture)
    try:
        yield now
    finally:
        restore_mixture(mixture, now)
