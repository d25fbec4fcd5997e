"""Messages of one line for errors in a command line."""

from __future__ import annotations

import re
from collections.abc import Sequence

from typer import TyperException

from experiments.errors import InputError, shown

FORMS = (
    (r"Missing (?:option|argument) '(?P<place>[^']*)'.*", "{place}: expected a value, found none"),
    (r"Option '(?P<place>[^']*)' requires an argument", "{place}: expected a value, found none"),
    (r"Invalid value for '(?P<place>[^']*)': (?P<why>.*)", "{place}: expected {expected}, found {found}"),
    (r"No such option: (?P<word>\S+?)(?P<guess> .*)?", "expected options of `{command} --help`, found {word}{guess}"),
    (r"No such command '(?P<word>[^']*)'(?P<guess>.*)", "expected a command of `softaim --help`, found {word}{guess}"),
    (r"Got unexpected extra argument(?:s|\(s\))? \((?P<word>.*)\)", "expected no more arguments, found {word}"),
)
"""Messages of typer, and their replacements."""

EXPECTED = (
    (r"(?:Value error, )?'.*' is not one of (.*)", r"one of \1"),
    (r".*valid integer.*", "a whole number"),
    (r".*valid (?:number|float).*", "a number"),
    (r".*greater than or equal to (\S+)", r"\1 or more"),
    (r".*less than or equal to (\S+)", r"\1 or less"),
    (r".*greater than (\S+)", r"more than \1"),
    (r".*less than (\S+)", r"less than \1"),
)
"""Messages of typer about a wrong value, and our descriptions of the expected value."""


def one_line(fault: TyperException, command: str, arguments: Sequence[str]) -> str:
    """Message of one line about a wrong call; command: the called command; arguments: all words after `softaim`."""
    message = " ".join(fault.format_message().split()).removesuffix(".")
    for form, text in FORMS:
        if (parts := re.fullmatch(form, message)) is not None:
            named = {key: value or "" for key, value in parts.groupdict().items()}
            found = _value(arguments, named.get("place", ""))
            message = text.format(**named, command=command, found=found, expected=_expected(named.get("why", "")))
            break
    return f"{command.removeprefix('softaim').strip()}: {message}".removeprefix(": ")


def _expected(why: str) -> str:
    for form, text in EXPECTED:
        if (parts := re.fullmatch(form, why)) is not None:
            return parts.expand(text)
    return why


def _value(arguments: Sequence[str], option: str) -> str:
    """The value of an option on the command line, in quotes."""
    for word, following in zip(arguments, [*arguments[1:], ""], strict=True):
        if word == option:
            return shown(following)
        if word.startswith(f"{option}="):
            return shown(word.removeprefix(f"{option}="))
    return "another"


def refused(fault: OSError) -> InputError:
    """Convert an OSError about a file name to an InputError."""
    return InputError.at(shown(str(fault.filename)), "a name that can be used", (fault.strerror or "a fault").lower())
