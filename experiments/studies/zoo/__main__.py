"""Zoo of bodies: accuracy of the filter, with the same settings, on bodies with different physics.

    python -m experiments.studies.zoo --out FOLDER                       # all cells, seeds 1000 to 1019
    python -m experiments.studies.zoo --seeds 2 --first-seed 0 --bodies chain2,sheet --out FOLDER
    python -m experiments.studies.zoo --quick --out FOLDER               # a few seconds of three bodies

Runs use all cores or `--scheduler ADDRESS`. FOLDER gets runs/runs.parquet, runs.csv, cells.csv and table.md. The
extra `dev` installs MuJoCo, which computes the truths. Latest figures: docs/zoo.md.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import pandas as pd

from experiments.engine.progress import run_bar
from experiments.engine.study import run_study
from experiments.engine.workers import chosen_workers
from experiments.formats.outputs import write_whole
from experiments.simulation.bodies.zoo import BODIES
from experiments.studies.grid import add_seeds, chosen, command, publish, seeds_of, study_options
from experiments.studies.zoo.case import REPORT_SEEDS, cases, quick_cases
from experiments.studies.zoo.run import record_of
from experiments.studies.zoo.table import cells_of, markdown, page_tables


def write_results(table: pd.DataFrame, folder: Path) -> str:
    """Write runs.csv, cells.csv and table.md; returns the table as text."""
    cells = cells_of(table)
    page = markdown(cells)
    write_whole(folder / "runs.csv", table.to_csv(index=False))
    write_whole(folder / "cells.csv", pd.DataFrame([asdict(cell) for cell in cells]).to_csv(index=False))
    write_whole(folder / "table.md", page)
    return page


@command
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the cases that the arguments choose; returns 1 if some of them failed."""
    parser = study_options(__doc__, page="zoo.md")
    parser.add_argument("--quick", action="store_true", help="run only a few seconds of three bodies")
    add_seeds(parser, len(REPORT_SEEDS), REPORT_SEEDS[0])
    parser.add_argument("--bodies", default=",".join(BODIES), help="names of bodies, separated by commas")
    given = parser.parse_args(arguments)
    bodies = chosen("--bodies", given.bodies.split(","), BODIES)
    tables = [asdict(case) for case in (quick_cases() if given.quick else cases(bodies, seeds_of(given)))]
    with run_bar("zoo") as advance:
        done = run_study(record_of, tables, given.out / "runs", chosen_workers(given), advance)
    page = write_results(done.table, given.out)
    publish(given, page, {"zoo table": page_tables(cells_of(done.table))})
    for failure in done.failures:
        sys.stderr.write(f"{failure}\n")
    return 1 if done.failures else 0


if __name__ == "__main__":
    sys.exit(main())
