"""Markdown: tables, and generated parts of pages between the comments `<!-- NAME -->` and `<!-- end of NAME -->`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from experiments.formats.outputs import write_whole


def markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]], left: Sequence[int] = (0,)) -> str:
    """A table in Markdown; the columns in `left` are left-aligned, the others right-aligned."""
    ruled = ["---" if k in left else "---:" for k in range(len(heads))]
    return "".join(
        "| " + " | ".join(entry.replace("|", "/") for entry in row) + " |\n" for row in (heads, ruled, *rows)
    )


def replaced(text: str, parts: Mapping[str, str]) -> str:
    """The text of a page with new content of its generated parts; ValueError if the comments of a part are missing."""
    for name, content in parts.items():
        start, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
        before, found, rest = text.partition(start)
        _, ended, after = rest.partition(end)
        if not found or not ended:
            raise ValueError(f"expected {start} and {end}, found none")
        text = f"{before}{start}\n{content.strip()}\n{end}{after}"
    return text


def rewrite_page(page: Path, parts: Mapping[str, str]) -> None:
    """Replace the content of generated parts of a page; if a part is missing, raise ValueError and change nothing."""
    write_whole(page, replaced(page.read_text(encoding="utf-8"), parts))
