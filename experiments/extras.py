"""Extras: packages that some commands need and that are not installed by default."""

from __future__ import annotations

from importlib.util import find_spec

from experiments.errors import InputError

EXTRAS = {
    "live": ("starlette", "uvicorn", "websockets"),
    "cluster": ("dask", "distributed", "pyarrow"),
    "export": ("mcap",),
    "mesh": ("meshio", "pytetwild"),
}
"""Packages of each extra, as in pyproject.toml."""


def missing(extra: str) -> str | None:
    """The first package of an extra that is not installed; None if all are installed."""
    return next((name for name in EXTRAS[extra] if find_spec(name) is None), None)


def needed(extra: str) -> str:
    """Text for a message: the name of an extra, and the command that installs it."""
    return f'the extra {extra} (pip install "softaim[{extra}]")'


def require(asked_by: str, *extras: str) -> None:
    """Raise InputError if an extra is not installed. The message names `asked_by`, the option or file that needs it."""
    for extra in extras:
        if (name := missing(extra)) is not None:
            raise InputError.at(asked_by, needed(extra), f"no {name}")
