"""Conversion of values for JSON, and text such as `2 marks` for messages."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any


def plain(value: Any) -> Any:
    """A value that JSON can represent: paths become text, and numbers that are not finite become None."""
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if isinstance(value, float) and not -float("inf") < value < float("inf"):
        return None
    return value


def amount(value: float, unit: str, larger: str) -> str:
    """A value with its unit, or from 10,000 on in a unit 1000 times as large."""
    return f"{value:.4g} {unit}" if value < 1e4 - 0.5 else f"{1e-3 * value:.4g} {larger}"


def counted(n: int, one: str, many: str = "") -> str:
    """A number with its noun, such as `2 marks`; many: the plural, by default with an s."""
    return f"{n} {one if n == 1 else many or one + 's'}"
