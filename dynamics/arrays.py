"""Types of arrays, and pickling of records with read-only arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Floats = NDArray[np.float64]


def made_again(record: DataclassInstance) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    """Result for the `__reduce__` of a record. Pickling and copying then construct the record again from its fields.

    The constructor checks the new record and makes its arrays read-only. For writable arrays, numba would compile its
    kernels again.
    """
    return type(record), tuple(getattr(record, field.name) for field in fields(record) if field.init)
