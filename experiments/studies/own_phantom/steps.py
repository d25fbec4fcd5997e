"""The commands of a new user, typed and timed."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pandas as pd

from experiments.errors import InputError
from experiments.studies.grid import markdown_table

PHANTOMS = {
    "plane of 5 masses": ("--kind", "plane", "--masses", "5"),
    "plane of 12 masses": ("--kind", "plane", "--masses", "12"),
    "breast of 10 masses, in space": ("--kind", "breast", "--masses", "10"),
}


def steps_of(project: Path) -> list[list[str]]:
    """The commands of the project's STEPS.md, without `softaim`, in their order; those for a real phantom left out."""
    lines = (project / "STEPS.md").read_text(encoding="utf-8").splitlines()
    commands = [line.split()[1:] for line in lines if line.startswith("softaim ")]
    return [command for command in commands if command[0] != "record"]


def typed(command: list[str], folder: Path) -> float:
    """Type a command of `softaim` in a folder; how long it took [s]. Raises InputError where it fails."""
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", "from experiments.commands.app import main; main()", *command],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise InputError(f"softaim {' '.join(command)}: expected exit code 0, found {done.returncode}: {done.stderr}")
    return time.perf_counter() - start


def stepped(name: str, folder: Path) -> list[dict[str, Any]]:
    """All steps of a phantom, from `softaim new` on: a row for each command, and the seconds that it took."""
    new = ["new", folder.name, *PHANTOMS[name]]
    rows = [{"phantom": name, "command": " ".join(new), "seconds": typed(new, folder.parent)}]
    for command in steps_of(folder):
        rows.append({"phantom": name, "command": " ".join(command), "seconds": typed(command, folder)})
    return rows


def times_table(rows: pd.DataFrame) -> str:
    """A row for each step, a column for each phantom: seconds."""
    step = rows["command"].str.split().str[0]
    step = step.where(~rows["command"].str.contains("--at-rest"), "identify --at-rest")
    sums = rows.assign(step=step).pivot_table("seconds", "step", "phantom", "sum", sort=False)
    rows = [*sums.iterrows(), ("all", sums.sum())]
    return markdown_table(
        ["step [s]", *sums.columns], [[str(name), *(f"{value:.0f}" for value in row)] for name, row in rows]
    )
