"""A filter's call that raises leaves its state unchanged."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

from dynamics.threads import one_blas_thread


class Restorable(Protocol):
    """What can be restored to an earlier state."""

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
    """The method, in one thread; a call that raises leaves the state unchanged."""

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
