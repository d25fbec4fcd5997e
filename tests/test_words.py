"""Plain words: pages, help and source use the terms of the field, such as predicted, observed and posterior."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from experiments.commands.page import sections

ROOT = Path(__file__).parent.parent
PAGES = [
    *(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
SOURCE = [
    path
    for folder in ("dynamics", "estimators", "vision", "experiments", "tests")
    for path in sorted((ROOT / folder).rglob("*"))
    if path.suffix in {".py", ".js", ".html", ".json", ".toml"} and path != Path(__file__)
]
ROOMS = sorted({path.parent.relative_to(ROOT).parts[:2] for path in SOURCE})

WORDS = {
    "told": "reported, predicted, stated",
    "c(?:ame|omes?) true": "observed",
    "beliefs?": "estimate, prior, posterior",
    "believed?": "assumed, trusted",
    "carried": "supported, moved, contributed",
    "anew": "again",
    "rivals?": "alternative, reference",
    "blows?": "disturbance",
    "by hand": "manually, in closed form",
    "hand(?:s|ed) on": "passes, passed",
}
"""Words that need a glossary of ours, and what to write in their place; part of a name counts, too: `came_true`."""

PLAIN = re.compile(
    r"(?<![A-Za-z])(?:" + "|".join(WORDS).replace(" ", r"(?:_|\s+(?:\#\s+)?)") + r")(?![A-Za-z])", re.IGNORECASE
)
INVERTED = re.compile(r'(?:(?<=[.;:] )|(?<=""")|^[ #]*)Of (?:an?|what|whom) ', re.MULTILINE)
"""A sentence that begins with "of", as "Of a body that turns the mean is left out": say "for"."""


def findings(text: str) -> Iterator[str]:
    """Line and words of each finding, in order."""
    found = [*PLAIN.finditer(text), *INVERTED.finditer(text)]
    for one in sorted(found, key=lambda one: one.start()):
        yield f"{text.count(chr(10), 0, one.start()) + 1}: {' '.join(one.group().split())}"


def text_of(page: Path) -> str:
    """A page; the changelog without names in backticks, for it names what was renamed."""
    text = page.read_text(encoding="utf-8")
    return re.sub(r"`[^`\n]*`", "``", text) if page.name == "CHANGELOG.md" else text


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_uses_plain_words(page: Path) -> None:
    found = [f"{page.relative_to(ROOT)}:{one}" for one in findings(text_of(page))]
    assert not found, "\n".join(found)


def test_help_uses_plain_words() -> None:
    found = [f"help: {one}" for section in sections() for one in findings(section)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("room", ROOMS, ids="/".join)
def test_source_uses_plain_words(room: tuple[str, ...]) -> None:
    """Names, keys, messages, docstrings and comments."""
    files = [path for path in SOURCE if path.parent.relative_to(ROOT).parts[:2] == room]
    found = [f"{path.relative_to(ROOT)}:{one}" for path in files for one in findings(path.read_text(encoding="utf-8"))]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("What is told\nof hits", ["1: told"]),
        ("the column `came_true`", ["1: came_true"]),
        ("# nothing came\n# true", ["1: came # true"]),
        ("def begin_anew():", ["1: anew"]),
        ("It ends. Of a body that turns it is none.", ["1: Of a"]),
        ("The arrival, a retold story; the mean of a body.", []),
    ],
)
def test_words_are_found_by_line(text: str, expected: list[str]) -> None:
    assert list(findings(text)) == expected
