"""The command line as a user calls it, within the process of a test."""

import sys
from functools import cache
from unittest.mock import patch

import typer.main

from experiments.commands.app import main

MADE = cache(typer.main.get_command)
"""All commands with their options, made once: else most of what a refused call takes."""


def softaim(*words: object) -> int:
    """Exit code of `softaim` with these words."""
    with patch.object(sys, "argv", ["softaim", *map(str, words)]), patch.object(typer.main, "get_command", MADE):
        try:
            main()
        except SystemExit as end:
            return int(end.code or 0)
    return 0
