"""Real breathing lungs: the filter and a thin-plate spline estimate inner landmarks from those on the hull.

    python -m experiments.studies.lungs FOLDER              # prints the table; --page writes it to docs/zoo.md

FOLDER has `case1.csv` and so on with `landmark,phase,x_mm,y_mm,z_mm`; phase 0 is the end of inhaling, the last phase is
the end of exhaling. The page uses landmarks of DIR-Lab [castillo2009], which are not part of the repository. Each lung
is a body without anchors. Latest figures: docs/zoo.md.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from estimators import coverage
from experiments.engine.workers import chosen_workers, workers_for
from experiments.formats.page import markdown_table
from experiments.studies.grid import command, publish, runs_of, study_options
from experiments.studies.lungs.estimate import SEEN, inner_errors
from experiments.studies.lungs.landmarks import Lung, read_lungs
from experiments.studies.lungs.model import LungConstants

HEAD = (
    "landmarks seen",
    "no motion [mm]",
    "spline [mm]",
    "filter [mm]",
    "coverage",
    "spline, all phases [mm]",
    "filter, all phases [mm]",
    "coverage, all phases",
)


def run(job: tuple[Lung, str]) -> pd.DataFrame:
    """Errors in one lung; job: the lung, and a name in `SEEN` for the number of visible landmarks."""
    return inner_errors(*job, LungConstants())


def markdown(errors: pd.DataFrame) -> str:
    """Mean errors and coverage at the end of exhaling and in all phases."""
    rows = []
    for seen in SEEN:
        own = errors[errors["seen"] == seen]
        last = own[own["phase"] == own["phase"].max()]
        rows.append((seen, *_figures(last, "nothing", "spline", "filter"), *_figures(own, "spline", "filter")))
    return markdown_table(HEAD, rows)


def _figures(table: pd.DataFrame, *methods: str) -> list[str]:
    covered = f"{100 * coverage(table['nees'].to_numpy(), 3):.1f}%"
    return [*(f"{table[f'{method}_mm'].mean():.2f}" for method in methods), covered]


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table of a folder of landmarks."""
    parser = study_options(__doc__, out=False, page="zoo.md")
    parser.add_argument("folder", type=Path, help="folder with case1.csv and so on")
    given = parser.parse_args(arguments)
    jobs = [(lung, seen) for seen in SEEN for lung in read_lungs(given.folder)]
    page = markdown(pd.concat(runs_of(run, jobs, workers_for(len(jobs), chosen_workers(given)))))
    publish(given, page, {"lungs table": page})


if __name__ == "__main__":
    sys.exit(main())
