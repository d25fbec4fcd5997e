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
    """Result of `__reduce__`: a pickled or copied record is constructed again from its fields.

    The fields are therefore checked again, and the arrays are read-only. Without this, unpickled arrays would be
    writable, and numba would compile its kernels again for them.
    """
    return type(record), tuple(getattr(record, field.name) for field in fields(record) if field.init)
