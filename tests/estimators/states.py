"""The state of a filter as something that can be compared bit for bit."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np


def digest(state: object) -> object:
    """A snapshot, or any part of one, as nested tuples of bytes and numbers: equal for equal bits, and only then."""
    if isinstance(state, np.ndarray):
        return (state.shape, state.dtype.str, state.tobytes())
    if is_dataclass(state):
        return tuple(digest(getattr(state, field.name)) for field in fields(state))
    if isinstance(state, Mapping):
        return tuple((key, digest(state[key])) for key in sorted(state))
    if isinstance(state, tuple):
        return tuple(digest(part) for part in state)
    return np.float64(state).tobytes() if isinstance(state, float) else state
