"""The page of the zoo, docs/zoo.md: its tables between comments, and its picture."""

from __future__ import annotations

from pathlib import Path

from experiments.formats.outputs import write_whole

PAGE = Path(__file__).parents[3] / "docs" / "zoo.md"
PICTURE = PAGE.parent / "images" / "zoo.png"


def rewritten(text: str, name: str, made: str) -> str:
    """The page with what stands between the comments of that name replaced; ValueError where they are missing."""
    start, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    if start not in text or end not in text:
        raise ValueError(f"{PAGE.name}: expected {start} and {end}, found none")
    before, rest = text.split(start, 1)
    return f"{before}{start}\n{made.strip()}\n{end}{rest.split(end, 1)[1]}"


def rewrite_page(name: str, made: str, picture: bytes | None = None) -> None:
    """Put a table between its comments, and the picture where the page shows it."""
    write_whole(PAGE, rewritten(PAGE.read_text(encoding="utf-8"), name, made))
    if picture is not None:
        write_whole(PICTURE, picture)
