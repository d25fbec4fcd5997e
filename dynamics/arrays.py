"""Types of arrays, and records of arrays that cannot be written."""

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
    """For `__reduce__`: a pickled or copied record is made again from its fields.

    So it is checked, and its arrays are read-only again: an unpickled array is writable, and numba compiles its kernels
    again for writable arrays.
    """
    return type(record), tuple(getattr(record, field.name) for field in fields(record) if field.init)
