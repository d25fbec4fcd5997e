"""The zoo of bodies: how the filter does on bodies of another's physics, all with the same settings.

    python -m experiments.studies.zoo --out FOLDER                       # all cells, seeds 1000 to 1019
    python -m experiments.studies.zoo --seeds 0-1 --bodies chain2,sheet --out FOLDER
    python -m experiments.studies.zoo --quick --out FOLDER               # a few seconds of three bodies

writes runs/runs.parquet, runs.csv, cells.csv, table.md and zoo.png, on all cores or with `--scheduler ADDRESS`. Truths
by MuJoCo, in the extra `dev`. Last figures: docs/zoo.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from dataclasses import asdict, replace
from pathlib import Path

import pandas as pd

from experiments.engine.progress import run_bar
from experiments.engine.study import run_study
from experiments.engine.workers import add_worker_options, chosen_workers
from experiments.errors import InputError
from experiments.formats.outputs import write_whole
from experiments.formats.page import rewrite_page
from experiments.plots.style import saved
from experiments.simulation.bodies.zoo import BODIES
from experiments.studies.zoo.case import REPORT_SEEDS, cases, quick_cases
from experiments.studies.zoo.picture import zoo_figure
from experiments.studies.zoo.run import record_of
from experiments.studies.zoo.table import PAGE, cells_of, markdown

PICTURE = PAGE.parent / "images" / "zoo.png"


def write_results(table: pd.DataFrame, folder: Path) -> str:
    """Write runs.csv, cells.csv, table.md and zoo.png; the table as text."""
    cells = cells_of(table)
    page = markdown(cells)
    write_whole(folder / "runs.csv", table.to_csv(index=False))
    write_whole(folder / "cells.csv", pd.DataFrame([asdict(cell) for cell in cells]).to_csv(index=False))
    write_whole(folder / "table.md", page)
    write_whole(folder / "zoo.png", saved(zoo_figure(cells), "png"))
    return page


def _seeds(text: str) -> range:
    first, _, last = text.partition("-")
    if not first.isdecimal() or not (last or first).isdecimal():
        raise InputError.at("--seeds", "A or A-B", text)
    return range(int(first), int(last or first) + 1)


def _bodies(text: str) -> tuple[str, ...]:
    names = tuple(text.split(","))
    for name in names:
        if name not in BODIES:
            raise InputError.at("--bodies", f"names among {', '.join(BODIES)}", name)
    return names


def main(arguments: Iterable[str] | None = None) -> int:
    """Run the cases that the arguments choose; the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m experiments.studies.zoo", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--quick", action="store_true", help="a few seconds of three bodies")
    parser.add_argument("--seeds", default=f"{REPORT_SEEDS[0]}-{REPORT_SEEDS[-1]}", help="A-B, both included")
    parser.add_argument("--bodies", default=",".join(BODIES), help="names, with commas between them")
    parser.add_argument("--unscaled", action="store_true", help="without the scaled bodies")
    parser.add_argument(
        "--out", type=Path, required=True, help="a study that was ended goes on; another filter needs another folder"
    )
    parser.add_argument(
        "--limit-s", type=float, default=60.0, help="processor time of the filter in a run: %(default)s"
    )
    parser.add_argument("--page", action="store_true", help="rewrite the table and the picture of docs/zoo.md")
    add_worker_options(parser)
    given = parser.parse_args(None if arguments is None else list(arguments))
    try:
        chosen = (
            quick_cases()
            if given.quick
            else cases(_bodies(given.bodies), _seeds(given.seeds), scaled=not given.unscaled)
        )
        tables = [replace(case, limit_s=given.limit_s).to_json() for case in chosen]
        with run_bar("zoo") as advance:
            done = run_study(record_of, tables, given.out / "runs", chosen_workers(given), advance)
        page = write_results(done.table, given.out)
        sys.stdout.write(page)
        if given.page:
            rewrite_page(PAGE, {"zoo table": page})
            write_whole(PICTURE, (given.out / "zoo.png").read_bytes())
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    for failure in done.failures:
        sys.stderr.write(f"{failure}\n")
    return 1 if done.failures else 0


if __name__ == "__main__":
    sys.exit(main())
