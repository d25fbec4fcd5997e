"""The command `softaim`: its subcommands, registered.

Each imports what it needs when it runs, so that help is instant.
"""

from __future__ import annotations

import sys

import typer

from experiments.commands.assess.bench import bench
from experiments.commands.assess.demo import demo
from experiments.commands.assess.sweep import sweep
from experiments.commands.estimate.compare import compare
from experiments.commands.estimate.identify import identify
from experiments.commands.estimate.live import live
from experiments.commands.estimate.track import track
from experiments.commands.estimate.tune import tune
from experiments.commands.guide.advise import advise
from experiments.commands.guide.insert import insert
from experiments.commands.guide.plan import plan
from experiments.commands.prepare.calibrate import calibrate
from experiments.commands.prepare.hue import hue
from experiments.commands.prepare.record import record
from experiments.commands.prepare.simulate import simulate

COMMANDS = (
    simulate,
    track,
    compare,
    calibrate,
    advise,
    identify,
    tune,
    plan,
    insert,
    demo,
    live,
    record,
    hue,
    sweep,
    bench,
)
"""In the order in which help lists them."""

app = typer.Typer(
    name="softaim",
    help="Where a hidden target in moving soft tissue is, and how sure of it one may be.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # rich would take as long to load as all else
)
for command in COMMANDS:
    app.command(short_help=(command.__doc__ or "").split("\n", maxsplit=1)[0])(command)


def main() -> None:
    """Run the command; bad input is one line on standard error and exit code 2."""
    try:
        app()
    except Exception as fault:
        if not is_bad_input(fault):
            raise
        print(f"softaim: {fault}", file=sys.stderr)
        sys.exit(2)


def is_bad_input(fault: Exception) -> bool:
    """Whether what was given is at fault and not the program."""
    from dynamics import NetworkError
    from experiments.errors import InputError
    from vision import CalibrationError, HueError, SourceError

    return isinstance(fault, InputError | NetworkError | SourceError | HueError | CalibrationError)
