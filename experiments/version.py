"""Version of the installed program."""

from __future__ import annotations

from importlib.metadata import version as installed


def version() -> str:
    """Version of the program that is installed."""
    return installed("softaim")
