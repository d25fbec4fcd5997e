"""Benefit of each mechanism of the filter: results for the same recordings when one mechanism is turned off.

    python -m experiments.studies.ablation --out FOLDER --lungs LUNGS      # --page writes docs/ablation.md
    python -m experiments.studies.ablation --out FOLDER --only outliers --bodies phantom

LUNGS is a folder of landmark tables, see `experiments.studies.lungs`. An interrupted study continues in its folder.
Latest figures: docs/ablation.md.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from experiments.formats.page import markdown_table
from experiments.studies.ablation.recordings import BODIES, LUNG, recording
from experiments.studies.ablation.switches import SWITCHES, WHOLE
from experiments.studies.grid import chosen, command, grid, kept_runs, publish, seeds_of, study_options
from experiments.studies.zoo.scores import followed, hidden_scores

FIRST_SEED = 830
"""First seed of the study. All priors of the filter were chosen with smaller seeds."""

HEAD = ("without", "error ratio (largest)", "coverage (lowest) [points]", "bodies", "lines")
WHOLE_HEAD = (WHOLE, "error [mm]", "coverage")

FIGURES = ["error_m", "covered", "nees", "lost", "failed"]
"""Figures that are compared. If one of them changes when a mechanism is turned off, the mechanism changes the run."""


def run(case: Mapping[str, Any]) -> dict[str, Any]:
    """Figures of the filter on the recording of a case; `off` in the case names the mechanism that is turned off.

    error_m: mean error of hidden points in all frames [m]
    covered: coverage of the 95 % region; nees: mean NEES per dimension
    lost: number of frames that are not TRACKING; failed: why the run ended early, or an empty text
    """
    given, switch = recording(case["body"], case["seed"], case["lungs"]), SWITCHES[case["off"]]
    with switch.patched():
        found = followed(partial(switch.filter, given), given.network, given.targets, given.frames)
    n, read = len(found.status), found.covs + given.read_sd_m**2 * np.eye(given.network.dim)
    size_m = float(np.ptp(given.network.positions, axis=0).max())
    scores = hidden_scores(found.means, read, given.truth[:n], tracking=found.tracking, size_m=size_m)
    figures = {name: scores[name] for name in ("error_m", "covered", "nees")}
    return {**figures, "frames": n, "lost": n - int(found.tracking.sum()), "failed": found.failure}


def compared(runs: pd.DataFrame) -> pd.DataFrame:
    """A row for each mechanism: how errors and coverage change if it is turned off.

    error: mean error without the mechanism divided by mean error with it [1]; geometric mean over bodies
    covered: coverage without the mechanism minus coverage with it [percentage points]; mean over bodies
    most, least: largest `error` and lowest `covered` of a single body, each with the body's name
    changed: number of bodies with a change; bodies: number of all bodies; failed: number of runs that ended early

    If any body has a change, `error` and `covered` omit the bodies without a change.
    """
    keyed = runs.set_index(["body", "seed"])
    whole, rows = keyed[keyed["off"] == WHOLE], []
    for name, own in keyed[keyed["off"] != WHOLE].groupby("off", sort=False):
        before = whole.loc[own.index]
        is_so = (own[FIGURES] != before[FIGURES]).any(axis=1).groupby("body").any()
        counted = is_so | (not is_so.any())
        a, b = (each[["error_m", "covered"]].groupby("body").mean()[counted] for each in (own, before))
        ratio, points = a["error_m"] / b["error_m"], 100.0 * (a["covered"] - b["covered"])
        found = {"name": name, "error": np.exp(np.log(ratio).mean()), "covered": points.mean()}
        found |= {"most": (ratio.max(), ratio.idxmax()), "least": (points.min(), points.idxmin())}
        found |= {"changed": is_so.sum(), "bodies": len(is_so), "failed": (own["failed"] != "").sum()}
        rows.append(found)
    return pd.DataFrame(rows)


def whole_filter(runs: pd.DataFrame) -> str:
    """Table in Markdown for the filter with all mechanisms, with a row for each body."""
    whole = runs[runs["off"] == WHOLE].groupby("body", sort=False)[["error_m", "covered"]].mean()
    rows = [(str(body), f"{1e3 * m.error_m:.3g}", f"{100 * m.covered:.1f}%") for body, m in whole.iterrows()]
    return markdown_table(WHOLE_HEAD, rows)


def markdown(runs: pd.DataFrame) -> str:
    """The table of mechanisms in Markdown, in descending order of the error ratio."""
    rows = compared(runs).sort_values("error", ascending=False)
    return markdown_table(HEAD, [_shown(row) for row in rows.itertuples()])


def _shown(row: Any) -> tuple[str, ...]:
    errors = f"{row.error:.3f} ({row.most[0]:.2f} {row.most[1]})"
    covered = f"{row.covered:+.1f} ({row.least[0]:+.1f})"
    bodies = f"{row.changed}/{row.bodies}" + (f", {row.failed} runs ended early" if row.failed else "")
    return (row.name, errors, covered, bodies, str(SWITCHES[row.name].lines))


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Do the runs that the output folder lacks, and write the table."""
    parser = study_options(__doc__, page="ablation.md", seeds=(1, FIRST_SEED))
    parser.add_argument("--only", action="append", default=[], help="a mechanism; repeat for several; default: all")
    parser.add_argument("--bodies", action="append", default=[], help="a body; repeat for several; default: all")
    parser.add_argument("--lungs", type=Path, help="folder with case1.csv and so on; default: no lungs")
    given = parser.parse_args(arguments)
    bodies = chosen("--bodies", given.bodies, [*BODIES] if given.lungs is None else [*BODIES, LUNG])
    off = dict.fromkeys([WHOLE, *chosen("--only", given.only, SWITCHES)])
    seeds = seeds_of(given)
    cases = [
        {**case, "lungs": str(given.lungs)}
        for body in bodies
        for case in grid(body=[body], seed=seeds[:1] if body == LUNG else seeds, off=off)
    ]
    runs = kept_runs(run, cases, given.out, given).checked()
    page = markdown(runs)
    text = f"{whole_filter(runs)}\n{page}"
    publish(given, text, {"ablation table": page}, given.out / "table.md")


if __name__ == "__main__":
    sys.exit(main())
