"""Tables of tests as text, a row a line; and what is said of bad input."""

from collections.abc import Callable

import pytest

from experiments.errors import InputError


def complaint(call: Callable[..., object], *given: object, **options: object) -> str:
    """What is said of bad input, on one line."""
    with pytest.raises(InputError) as fault:
        call(*given, **options)
    assert str(fault.value).isprintable()
    return str(fault.value)


def rows(table: str) -> list[list[str]]:
    r"""The cells of each row, between ` | `; `\n` is a line break, and an indented line goes on with the one before."""
    lines = table.strip().replace("\n    ", " ").splitlines()
    return [[cell.replace(r"\n", "\n") for cell in line.split(" | ")] for line in lines]
