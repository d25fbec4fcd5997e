"""Help is complete, and loads nothing that it does not need."""

import subprocess
import sys
from functools import cache

import pytest

from experiments.commands.app import COMMANDS


def softaim(*words: str) -> str:
    code = f"import sys; sys.argv = ['softaim', *{words!r}]; from experiments.commands.app import main; main()"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_help_lists_every_subcommand_with_its_first_line() -> None:
    shown = " ".join(softaim("--help").split())
    for command in COMMANDS:
        first = (command.__doc__ or "").split("\n")[0]
        assert f"{command.__name__} {first}" in shown


@cache
def loaded_by_help() -> frozenset[str]:
    """All modules that help loads."""
    code = (
        "import sys; sys.argv = ['softaim', '--help']\n"
        "from experiments.commands.app import app\n"
        "app(standalone_mode=False)\n"
        "print(*sys.modules, file=sys.stderr)"
    )
    return frozenset(
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stderr.split()
    )


@pytest.mark.parametrize("module", ["numpy", "numba", "cv2", "rich.markdown", "experiments.formats"])
def test_help_does_not_load(module: str) -> None:
    assert "experiments.commands.app" in loaded_by_help()
    assert module not in loaded_by_help()


def test_the_program_has_one_thread_for_each_library_unless_told_otherwise() -> None:
    """More of them wait for each other: `fixed_interval` on 600 frames then took 200 s in place of 3."""
    code = (
        "import os, sys; os.environ['OMP_NUM_THREADS'] = '3'; os.environ.pop('OPENBLAS_NUM_THREADS', None)\n"
        "sys.argv = ['softaim', '--version']\n"
        "from experiments.commands.app import main\n"
        "try: main()\n"
        "except SystemExit: print(os.environ['OPENBLAS_NUM_THREADS'], os.environ['OMP_NUM_THREADS'])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.splitlines()[-1] == "1 3"
