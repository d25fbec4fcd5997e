"""The timed steps of a new user, and insertions into recordings of the resulting project."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from experiments.errors import InputError
from experiments.formats.needle_file import read_needle
from experiments.formats.recording import read_recording
from experiments.formats.scenario import read_scenario
from experiments.pipeline.advise import advise, table
from experiments.simulation.simulate import simulate
from experiments.studies.grid import markdown_table

PHANTOMS = {
    "plane of 5 masses": ("--kind", "plane", "--masses", "5"),
    "plane of 12 masses": ("--kind", "plane", "--masses", "12"),
    "breast of 10 masses, in space": ("--kind", "breast", "--masses", "10"),
}


def steps_of(project: Path) -> list[list[str]]:
    """The commands of the project's STEPS.md in order, without `softaim` and without those for a real phantom."""
    lines = (project / "STEPS.md").read_text(encoding="utf-8").splitlines()
    commands = [line.split()[1:] for line in lines if line.startswith("softaim ")]
    return [command for command in commands if command[0] != "record"]


def typed(command: list[str], folder: Path) -> float:
    """Run a command of `softaim` in a folder; returns its time [s]. Raises InputError if it fails."""
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
    """All steps of a phantom, beginning with `softaim new`: a row for each command, with its time [s]."""
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


EVERY_S = 0.25
"""Interval of insertions [s]: about 75 in a recording of 20 s, without those that arrive after its end; parameter of
the study."""

LAST = ("tuned.toml", "identified.toml")
"""The final scene of a project's steps: tuned if its filter has levels to tune."""


OF_HITS = ("predicted", "observed")
HEADS = ("phantom", "recordings", "insertions", *OF_HITS, "observed - predicted, 95 %", "GO", *OF_HITS)


def insertions(case: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Insertions into one recording of a project: predicted, observed hit, advice; case: phantom, project, seed.

    Raises InputError if no true target is known.
    """
    project = Path(case["project"])
    scenario = read_scenario(str(project / "scenario.toml")).model_copy(update={"seed": case["seed"]})
    with tempfile.TemporaryDirectory() as folder:
        simulate(scenario, Path(folder) / "rec")
        last = next(project / name for name in LAST if (project / name).exists())
        recording = read_recording(Path(folder) / "rec", last)
        scene = recording.scene
        plan = read_needle(project / "needle.toml", scene.target.radius_m, scene.network.dim)
        rows = table(advise(recording, plan, every_s=EVERY_S))
    if "observed" not in rows:
        raise InputError.at(f"{project}, seed {case['seed']}", "insertions whose true target is known", "none")
    known = rows[np.isfinite(rows["p_hit"]) & np.isfinite(rows["observed"])]
    return [
        {"time_s": row.time_s, "predicted": row.p_hit, "observed": row.observed, "advice": row.advice}
        for row in known.itertuples()
    ]


def reliability_table(found: pd.DataFrame) -> str:
    """A row for each phantom: hit rates predicted and observed, of all insertions and of those with GO.

    The interval is of the mean difference over recordings, 1.96 standard errors: insertions of one are not independent.
    """
    table = []
    for name, rows in found.groupby("phantom", sort=False):
        gaps = (rows["observed"] - rows["predicted"]).groupby(rows["seed"]).mean()
        half = 1.96 * float(gaps.std(ddof=1)) / np.sqrt(len(gaps)) if len(gaps) > 1 else np.inf
        gap = float((rows["observed"] - rows["predicted"]).mean())
        go = rows[rows["advice"] == "GO"]
        counts = [str(len(gaps)), str(len(rows)), _mean(rows["predicted"]), _mean(rows["observed"])]
        share = [f"{100 * gap:+.1f} ± {100 * half:.1f} points", f"{len(go) / len(rows):.0%}"]
        table.append([str(name), *counts, *share, _mean(go["predicted"]), _mean(go["observed"])])
    return markdown_table(HEADS, table)


def _mean(shares: pd.Series) -> str:
    return f"{shares.mean():.1%}" if len(shares) else "–"
