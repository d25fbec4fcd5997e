"""Help is complete, and loads nothing that it does not need."""

import subprocess
import sys

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


@pytest.mark.parametrize("module", ["numpy", "numba", "cv2", "rich.markdown", "experiments.formats"])
def test_help_does_not_load(module: str) -> None:
    code = (
        "import sys; sys.argv = ['softaim', '--help']\n"
        "from experiments.commands.app import app\n"
        "app(standalone_mode=False)\n"
        f"sys.exit({module!r} in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).returncode == 0
