"""Help is complete, and loads nothing that it does not need."""

import subprocess
import sys

import pytest

from experiments.commands.app import COMMANDS
from tests.experiments.command import softaim


def test_help_lists_every_subcommand_with_its_first_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert softaim("--help") == 0
    shown = " ".join(capsys.readouterr().out.split())
    for command in COMMANDS:
        first = (command.__doc__ or "").split("\n")[0]
        assert f"{command.__name__} {first}" in shown


def test_help_loads_nothing_that_is_slow() -> None:
    code = "import sys; sys.argv = ['softaim', '--help']\nfrom experiments.commands.app import app\n"
    code += "app(standalone_mode=False)\nprint(*sys.modules, file=sys.stderr)"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(ran.stderr.split())
    assert "experiments.commands.app" in loaded
    slow = {"numpy", "numba", "cv2", "matplotlib", "pandas", "scipy", "rich.markdown", "experiments.formats"}
    assert not slow & loaded


def test_the_program_has_one_thread_for_each_library_by_default() -> None:
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
