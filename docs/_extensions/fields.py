"""Docstrings in the form that numpydoc reads: fields, `name: text`, become sections, and keys of sources links."""

import inspect
import re
from itertools import chain

FIELD = re.compile(r"(Raises )?([A-Za-z_]\w*(?:, [a-z_]\w*)*): (.*)")
KEY = re.compile(r"\[([a-z]+\d{4}[a-z]?|paper)\](?!_)")


def annotations(thing: object) -> dict[str, object]:
    """Types of the parameters of a function, or of the fields of a class, as written in the code."""
    own = getattr(thing, "__init__", thing) if inspect.isclass(thing) else thing
    return {**getattr(own, "__annotations__", {}), **getattr(thing, "__annotations__", {})}


def as_numpydoc(lines: list[str], thing: object) -> list[str]:
    """The lines of a docstring with its fields in the sections Parameters and Raises, after the text.

    Each field begins a line or, if the thing has a parameter or field of this name, follows a semicolon. Lines that are
    indented or do not begin in upper case continue a field.
    """
    types = annotations(thing)
    known = "|".join(map(re.escape, types)) or "$^"
    beside = re.compile(rf"; (?=(?:{known})(?:, (?:{known}))*: )")
    text: list[str] = []
    parameters: list[str] = []
    raises: list[str] = []
    into = text
    for line in chain.from_iterable(map(beside.split, lines)):
        found = FIELD.match(line)
        names = found[2].split(", ") if found else []
        if found and found[1]:
            into = raises
            into += names
        elif found and names != ["State"] and (inspect.isclass(thing) or types.keys() >= set(names)):
            into = parameters
            into.append(f"{found[2]} : `{types[names[0]]}`" if isinstance(types.get(names[0]), str) else found[2])
        elif into is text or not line or line[0].isupper() or line[0] == "`":
            text += [line] if into is text else ["", line]
            into = text
            continue
        into.append(f"    {found[3] if found else line.strip()}")
    for title, section in (("Parameters", parameters), ("Raises", raises)):
        text += ["", title, "-" * len(title), *section] if section else []
    return text


def with_links(line: str) -> str:
    """A line whose keys in brackets, such as [paper], lead to REFERENCES.md."""
    return KEY.sub(r":doc:`[\1] </REFERENCES>`", line)
