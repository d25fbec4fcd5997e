"""The command `softaim` with all its subcommands.

Each subcommand imports what it needs when it runs, so that `--help` loads little.
"""

from __future__ import annotations

import atexit
import errno
import gc
import sys
from typing import Annotated, NoReturn

import typer
from typer import Option

from experiments.commands.assess import bench, demo, faults, sweep
from experiments.commands.cameras import calibrate, hue, record
from experiments.commands.estimate import compare, identify, live, replay, smooth, track, tune
from experiments.commands.exchange import export, import_table
from experiments.commands.faults import one_line, refused
from experiments.commands.guide import advise, insert, plan
from experiments.commands.prepare import check, new, register, simulate
from experiments.commands.run import subcommand
from experiments.errors import InputError
from experiments.interrupts import as_interrupts, terminations
from experiments.kernel_cache import keep_kernels
from experiments.threads import one_thread_each

COMMANDS = (
    new,
    check,
    simulate,
    track,
    smooth,
    replay,
    compare,
    calibrate,
    register,
    advise,
    identify,
    tune,
    plan,
    insert,
    demo,
    live,
    record,
    hue,
    export,
    import_table,
    sweep,
    bench,
    faults,
)
"""The commands in the order of the help."""

REFUSALS = frozenset({errno.ENAMETOOLONG, errno.ELOOP, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOTDIR})
"""Error codes of the operating system for file names that cannot be used."""

INTERRUPTED = 130
"""Exit code after Ctrl-C, as in shells."""

app = typer.Typer(
    name="softaim",
    help="Estimate the position of a hidden target in moving soft tissue, with its uncertainty.",
    invoke_without_command=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # rich takes as long to load as everything else
)
for command in COMMANDS:
    app.command(short_help=(command.__doc__ or "").split("\n", maxsplit=1)[0])(subcommand(command))


@app.callback()
def softaim(
    context: typer.Context, version: Annotated[bool, Option("--version", help="Print the version and end.")] = False
) -> None:
    """Estimate the position of a hidden target in moving soft tissue, with its uncertainty."""
    if version:
        from experiments.version import version as installed

        print(f"softaim {installed()}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(context.get_help())
        raise typer.Exit(2)


def main() -> None:
    """Run the command. Bad input ends it with one line on standard error and code 2, an interrupt with code 130."""
    one_thread_each()
    keep_kernels()
    atexit.register(gc.freeze)  # all memory goes with the process: to collect it first takes half a second
    try:
        with terminations(), as_interrupts():
            code = app(prog_name="softaim", standalone_mode=False)
    except typer.TyperException as fault:
        _end(one_line(fault, _words(), sys.argv[1:]), 2)
    except (typer.Abort, KeyboardInterrupt):
        _end("interrupted", INTERRUPTED)
    except Exception as fault:
        if not is_bad_input(fault):
            raise
        text = str(refused(fault)) if isinstance(fault, OSError) else str(fault)
        _end(" ".join(text.splitlines()), 2)
    if code == INTERRUPTED:
        _end("interrupted", INTERRUPTED)
    sys.exit(code if isinstance(code, int) else 0)


def _words() -> str:
    """The program's name, and the name of the called subcommand if the subcommand exists."""
    names = {command.__name__.replace("_", "-") for command in COMMANDS}
    return " ".join(["softaim", *(word for word in sys.argv[1:2] if word in names)])


def _end(text: str, code: int) -> NoReturn:
    print(f"softaim: {text}", file=sys.stderr)
    sys.exit(code)


def is_bad_input(fault: Exception) -> bool:
    """Whether the exception results from the input, not from an error in the program."""
    from dynamics import NetworkError
    from vision import CalibrationError, HueError, SourceError

    if isinstance(fault, OSError):
        return fault.filename is not None and fault.errno in REFUSALS
    return isinstance(fault, InputError | NetworkError | SourceError | HueError | CalibrationError)
