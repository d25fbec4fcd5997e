"""Insertions into recordings of a project: what was told, and what came true."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from experiments.formats.needle_file import read_needle
from experiments.formats.recording import read_recording
from experiments.formats.scenario import read_scenario
from experiments.pipeline.advise import advise, table
from experiments.simulation.simulate import simulate
from experiments.studies.grid import markdown_table

EVERY_S = 0.25
"""Between two insertions [s]: some 75 in a recording of 20 s, whose end no needle reaches; parameter of the study."""

LAST = ("tuned.toml", "identified.toml")
"""The scene that the steps of a project end with: tuned where its filter has levels to tune."""


HEADS = ("phantom", "recordings", "insertions", "told", "came true", "true - told, 95 %", "GO", "told", "came true")


def insertions(case: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Insertions into one recording of a project: told, true and advice of each; case: phantom, project, seed."""
    project = Path(case["project"])
    scenario = read_scenario(str(project / "scenario.toml")).model_copy(update={"seed": case["seed"]})
    with tempfile.TemporaryDirectory() as folder:
        simulate(scenario, Path(folder) / "rec")
        last = next(project / name for name in LAST if (project / name).exists())
        recording = read_recording(Path(folder) / "rec", last)
        scene = recording.scene
        plan = read_needle(project / "needle.toml", scene.target.radius_m, scene.network.dim)
        rows = table(advise(recording, plan, every_s=EVERY_S))
    known = rows[np.isfinite(rows["p_hit"]) & np.isfinite(rows["came_true"])]
    return [
        {"time_s": row.time_s, "told": row.p_hit, "true": row.came_true, "advice": row.advice}
        for row in known.itertuples()
    ]


def reliability_table(found: pd.DataFrame) -> str:
    """A row for each phantom: what was told and came true, of all insertions and of those with GO.

    The interval is of the mean difference over recordings, 1.96 standard errors: insertions of one are not independent.
    """
    table = []
    for name, rows in found.groupby("phantom", sort=False):
        gaps = (rows["true"] - rows["told"]).groupby(rows["seed"]).mean()
        half = 1.96 * float(gaps.std(ddof=1)) / np.sqrt(len(gaps)) if len(gaps) > 1 else np.inf
        gap = float((rows["true"] - rows["told"]).mean())
        go = rows[rows["advice"] == "GO"]
        counts = [str(len(gaps)), str(len(rows)), _mean(rows["told"]), _mean(rows["true"])]
        share = [f"{100 * gap:+.1f} ± {100 * half:.1f} points", f"{len(go) / len(rows):.0%}"]
        table.append([str(name), *counts, *share, _mean(go["told"]), _mean(go["true"])])
    return markdown_table(HEADS, table)


def _mean(shares: pd.Series) -> str:
    return f"{shares.mean():.1%}" if len(shares) else "–"
