"""Tables of tests as text, a row a line; and what is said of bad input."""

from collections.abc import Callable
from pathlib import Path

import pytest

from experiments.errors import InputError


def complaint(call: Callable[..., object], *given: object, **options: object) -> str:
    """What is said of bad input, on one line."""
    with pytest.raises(InputError) as fault:
        call(*given, **options)
    assert str(fault.value).isprintable()
    return str(fault.value)


def spoilt(read: Callable[..., object], path: Path, good: str, old: str, new: str) -> str:
    """What is said of a file after its path, where a part of its good text is replaced."""
    assert old in good
    path.write_text(good.replace(old, new, 1), encoding="utf-8")
    said = complaint(read, path)
    assert said.startswith(f"{path}: ")
    return said.removeprefix(f"{path}: ")


def rows(table: str) -> list[list[str]]:
    r"""The cells of each row, between ` | `; `\n` is a line break, and an indented line goes on with the one before."""
    lines = table.strip().replace("\n    ", " ").splitlines()
    return [[cell.replace(r"\n", "\n") for cell in line.split(" | ")] for line in lines]
