"""Values for messages and reports: as JSON, and counts with nouns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any


def plain(value: Any) -> Any:
    """A value in the form of JSON: paths as text, None for numbers that are not finite."""
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
    """A number with its noun, such as `2 marks`; many: the plural, by default with an s."""
    return f"{n} {one if n == 1 else many or one + 's'}"
