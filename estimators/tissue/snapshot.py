"""Snapshots of a filter, so that a call that raises an exception leaves the filter's state unchanged."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

from dynamics.threads import one_blas_thread


class Restorable(Protocol):
    """Protocol of an object whose state can be saved and restored."""

    def snapshot(self) -> Any:
        """The complete present state."""

    def restore(self, then: Any) -> None:
        """Reset the state to a snapshot."""


Owner = TypeVar("Owner", bound=Restorable)
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def all_or_nothing(
    method: Callable[Concatenate[Owner, Arguments], Result],
) -> Callable[Concatenate[Owner, Arguments], Result]:
    """Decorator: use one thread for linear algebra; restore the object's state if the method raises an exception."""

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
