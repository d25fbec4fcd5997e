"""docs/commands.md: every command with its arguments and options, from its help.

`python -m experiments.commands.page` writes it; with --check it reports whether it is up to date.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

from experiments.commands.app import app
from experiments.formats.outputs import write_whole
from experiments.formats.page import replaced

PAGE = Path(__file__).parents[2] / "docs" / "commands.md"
COMMON = {"--json", "--verbose", "--force", "--vector"}
"""Options that the page describes once, at its top."""


def sections() -> Iterator[str]:
    """A section for each command: purpose, usage, arguments and options."""
    group: Any = typer.main.get_command(app)
    for name, command in group.commands.items():
        context = command.make_context(name, [], resilient_parsing=True)
        usage = " ".join(command.collect_usage_pieces(context))
        yield f"### {name}\n\n{' '.join((command.help or '').split())}\n\n```text\nsoftaim {name} {usage}\n```\n"
        rows = [row for one in command.get_params(context) if one.name != "help" and (row := _row(one, context))]
        yield "| argument, option | what it is |\n| --- | --- |\n" + "".join(rows)


def _row(one: Any, context: Any) -> str:
    found = one.get_help_record(context)
    if found is None or set(one.opts) & COMMON:
        return ""
    left, right = (text.replace("|", "\\|") for text in found)
    return f"| `{left}` | {right} |\n"


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
