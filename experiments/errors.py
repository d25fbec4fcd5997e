"""Errors of input: one line that names the file, the key, what was expected and what was found."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from math import isfinite
from pathlib import Path

LONGEST_SHOWN = 60
"""Largest number of characters of a found value in a message, so that the message fits a line of a terminal."""

SOME_NAMES = 5
"""Largest number of nodes that a message lists; choice."""


class InputError(Exception):
    """Error for input that cannot be used; its message is one line, `file: key: expected …, found …`."""

    @classmethod
    def at(cls, place: object, expected: str, found: str) -> InputError:
        """The error at a place, such as `scene.toml: target.node`."""
        return cls(f"{place}: expected {expected}, found {found}")

    @classmethod
    def refused(cls, path: Path, expected: str, error: OSError) -> InputError:
        """The error for a file that the operating system cannot open, read or write."""
        return cls.at(path, expected, (error.strerror or type(error).__name__).lower())


@contextmanager
def placed(place: object, *kinds: type[Exception]) -> Iterator[None]:
    """Convert exceptions of these kinds in a `with` block into InputError, `place: message`."""
    try:
        yield
    except kinds as error:
        raise InputError(f"{place}: {error}".removeprefix(": ")) from error


@contextmanager
def accepted(path: Path, expected: str, numbers: Sequence[int] = ()) -> Iterator[None]:
    """Convert OSError in a `with` block into InputError. If `numbers` is stated, convert only these error numbers."""
    try:
        yield
    except OSError as error:
        if numbers and error.errno not in numbers:
            raise
        raise InputError.refused(path, expected, error) from error


def shown(value: object) -> str:
    """A value as text for a message: on one line, in the notation of a file, and shortened if it is long."""
    if isinstance(value, dict):
        return "a table"
    # a float by repr: json would write nan as NaN
    text = repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False, default=str)
    # json does not escape some line separators
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 1] + "…"


def coordinates(option: str, text: str, n: int, expected: str) -> list[float]:
    """The n finite numbers in the text of an option, separated by commas. Raises InputError for any other text."""
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if len(found) != n or not all(map(isfinite, found)):
        raise InputError.at(option, expected, shown(text))
    return found


def no_node(name: object, names: Iterable[str]) -> str:
    """Message on an unknown node: the unknown name, then names of existing nodes, the most similar name first."""
    known = list(names)
    similar = get_close_matches(str(name), known, n=1)
    first = [*similar, *(one for one in known if one not in similar)]
    some = ", ".join(shown(one)[1:-1] for one in first[:SOME_NAMES]) + (", …" if len(first) > SOME_NAMES else "")
    return f"no node named {shown(name)}; nodes: {some or 'none'}"


def read_text(path: Path) -> str:
    """The text of a UTF-8 file, without a byte order mark; InputError if the file cannot be read or is not UTF-8."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise InputError.at(path, "a file", "none") from None
    except IsADirectoryError:
        raise InputError.at(path, "a file", "a folder") from None
    except OSError as error:
        raise InputError.refused(path, "a file that can be read", error) from error
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError.at(f"{path}: line {line}", "UTF-8 text", f"byte 0x{content[error.start]:02x}") from None
