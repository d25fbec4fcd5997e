"""Write docs/commands.md: all commands with their arguments and options, from the texts of --help.

`python -m experiments.commands.page` writes the page; --check reports whether it is up to date.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

from experiments.commands.app import app
from experiments.formats.outputs import write_whole
from experiments.formats.page import replaced

PAGE = Path(__file__).parents[2] / "docs" / "commands.md"
COMMON = {"--json", "--verbose", "--force", "--vector"}
"""Options that the introduction of the page describes."""

SEVERAL = 3
"""The page describes an option only once if at least this many commands have it; choice."""

TYPES = re.compile(r" <(path|str|int|float|list\[.*\])( range)?>")
"""Types of values in the help. The page omits them, because the text of each option already describes its value."""

RANGE = r"(?:[\d.e+-]+<=)?x[<>]=[\d.e+-]+"
LIMITS = re.compile(rf" \[(required|{RANGE}(; required)?)\]$|; {RANGE}(?=\]$)")
"""Ends of option descriptions that the page omits: ranges, and `required`, because the usage shows it."""


def sections() -> Iterator[str]:
    """The sections of the page: first shared options, then a section for each command."""
    group: Any = typer.main.get_command(app)
    contexts = {name: one.make_context(name, [], resilient_parsing=True) for name, one in group.commands.items()}
    rows = {name: dict(_rows(group.commands[name], context)) for name, context in contexts.items()}
    count = Counter(row for own in rows.values() for row in own)
    shared = [row for row, n in count.items() if n >= SEVERAL]
    yield "### Options of several commands\n\n" + "".join(shared)
    for name, command in group.commands.items():
        own = [row for row in rows[name] if row not in shared]
        used = [use for row, use in rows[name].items() if row in shared or not use.startswith("[--")]
        usage = sorted(used, key=lambda use: "--" in use)  # arguments first
        text = " ".join((command.help or "").split())
        shown = " ".join([name, *usage])
        yield f"### {name}\n\n{text}\n\n`softaim {shown}`\n"
        if own:
            yield "".join(own)


def _rows(command: Any, context: Any) -> Iterator[tuple[str, str]]:
    """For each argument and option of a command: line on the page, and usage text. Options in `COMMON` are omitted."""
    for one in command.get_params(context):
        found = one.get_help_record(context)
        if found is None or one.name == "help" or set(one.opts) & COMMON:
            continue
        (left, right), (use, *_) = found, one.get_usage_pieces(context) or one.opts
        if one.param_type_name == "option":
            use = use if one.required else f"[{use}]"
        yield f"- `{TYPES.sub('', left)}` {LIMITS.sub('', ' '.join(right.split()))}\n", use


def page(text: str) -> str:
    """The page with new sections from the help; text: the old page."""
    return replaced(text, {"commands": "\n".join(sections())})


def main() -> None:
    """Write the page; with --check, only compare it with the help."""
    text = PAGE.read_text(encoding="utf-8")
    if "--check" in sys.argv:
        sys.exit(0 if page(text) == text else "docs/commands.md: python -m experiments.commands.page")
    write_whole(PAGE, page(text))


if __name__ == "__main__":
    main()
