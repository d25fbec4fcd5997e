"""What a message or a report holds: values as JSON can hold them, numbers of things in words."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any


def plain(value: Any) -> Any:
    """A value as JSON can hold it: paths as text, None for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if isinstance(value, float) and not -float("inf") < value < float("inf"):
        return None
    return value


def counted(n: int, one: str, many: str = "") -> str:
    """A number of things in words; many: their plural, where it is not one's with an s."""
    return f"{n} {one if n == 1 else many or one + 's'}"
