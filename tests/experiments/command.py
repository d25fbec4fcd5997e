"""The command line as a user calls it, within the process of a test."""

import sys
from functools import cache, partial
from unittest.mock import patch

import typer.main

from experiments.commands.app import main
from experiments.engine import progress

MADE = cache(typer.main.get_command)
"""All commands with their options, made once: else most of what a refused call takes."""

LATE = partial(progress.progress_lines, 3600.0)
"""Progress whose lines come after an hour: what a test reads does not depend on how busy the machine is."""


def softaim(*words: object) -> int:
    """Exit code of `softaim` with these words."""
    with (
        patch.object(sys, "argv", ["softaim", *map(str, words)]),
        patch.object(typer.main, "get_command", MADE),
        patch.object(progress, "progress_lines", LATE),
    ):
        try:
            main()
        except SystemExit as end:
            return int(end.code or 0)
    return 0
