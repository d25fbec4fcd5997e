"""docs/commands.md: every command with its arguments and options, from its help.

`python -m experiments.commands.page` writes it; with --check it reports whether it is up to date.
"""

from __future__ import annotations

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
"""Options that the page describes at its top, in other words than their help."""

SEVERAL = 3
"""Arguments and options that so many commands share are described once: a choice."""


def sections() -> Iterator[str]:
    """Options of several commands; then for each command purpose, usage, its own arguments and options."""
    group: Any = typer.main.get_command(app)
    contexts = {name: one.make_context(name, [], resilient_parsing=True) for name, one in group.commands.items()}
    rows = {name: _rows(group.commands[name], context) for name, context in contexts.items()}
    count = Counter(row for own in rows.values() for row in own)
    shared = [row for row, n in count.items() if n >= SEVERAL]
    yield "### Options of several commands\n\n" + "".join(shared)
    for name, command in group.commands.items():
        usage = " ".join(command.collect_usage_pieces(contexts[name]))
        text = " ".join((command.help or "").split())
        yield f"### {name}\n\n{text}\n\n`softaim {name} {usage}`\n"
        if own := "".join(row for row in rows[name] if row not in shared):
            yield own
        if names := [row.split("`")[1].split()[0] for row in rows[name] if row in shared]:
            yield f"As above: {', '.join(f'`{one}`' for one in names)}.\n"


def _rows(command: Any, context: Any) -> list[str]:
    return [row for one in command.get_params(context) if one.name != "help" and (row := _row(one, context))]


def _row(one: Any, context: Any) -> str:
    found = one.get_help_record(context)
    if found is None or set(one.opts) & COMMON:
        return ""
    left, right = found
    return f"- `{left.replace(' range>', '>')}` {' '.join(right.split())}\n"


def page(text: str) -> str:
    """The page with the present sections of the commands."""
    return replaced(text, {"commands": "\n".join(sections())})


def main() -> None:
    """Write the page, or check it."""
    text = PAGE.read_text(encoding="utf-8")
    if "--check" in sys.argv:
        sys.exit(0 if page(text) == text else "docs/commands.md: python -m experiments.commands.page")
    write_whole(PAGE, page(text))


if __name__ == "__main__":
    main()
