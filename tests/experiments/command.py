"""The command line as a user calls it, within the process of a test."""

import sys
from unittest.mock import patch

from experiments.commands.app import main


def softaim(*words: object) -> int:
    """Exit code of `softaim` with these words."""
    with patch.object(sys, "argv", ["softaim", *map(str, words)]):
        try:
            main()
        except SystemExit as end:
            return int(end.code or 0)
    return 0
