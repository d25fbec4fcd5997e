"""The zoo of bodies: how the filter does on bodies of another's physics, all with the same settings.

    python -m experiments.studies.zoo --out FOLDER                       # all cells, seeds 1000 to 1019
    python -m experiments.studies.zoo --seeds 0-1 --bodies chain2,sheet --out FOLDER
    python -m experiments.studies.zoo --quick --out FOLDER               # a few seconds of three bodies

writes runs.csv, cells.csv, table.md and zoo.png. Truths by MuJoCo (extra `dev`). Last figures: docs/zoo.md.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from experiments.errors import InputError
from experiments.formats.outputs import output_folder
from experiments.formats.tables import write_table
from experiments.simulation.bodies.zoo import BODIES
from experiments.studies.zoo.case import REPORT_SEEDS, Case, cases, quick_cases
from experiments.studies.zoo.picture import zoo_figure
from experiments.studies.zoo.run import Record, run
from experiments.studies.zoo.table import Cell, cells_of, markdown


def run_all(chosen: Sequence[Case]) -> list[Record]:
    """The record of each case, counted on standard error as they come."""
    records = []
    for k, case in enumerate(chosen):
        records.append(run(case))
        sys.stderr.write(f"\r{k + 1} of {len(chosen)} runs: {case.cell}, seed {case.seed}    ")
    sys.stderr.write("\n")
    return records


def write_results(records: Sequence[Mapping[str, Any]], folder: Path) -> str:
    """Write runs.csv, cells.csv, table.md and zoo.png; the table."""
    cells = cells_of(records)
    keys = list(dict.fromkeys(key for record in records for key in record))
    write_table(folder / "runs.csv", keys, [[_text(record.get(key)) for key in keys] for record in records])
    names = [field.name for field in fields(Cell)]
    write_table(folder / "cells.csv", names, [[_text(value) for value in asdict(cell).values()] for cell in cells])
    page = markdown(cells)
    (folder / "table.md").write_text(page, encoding="utf-8")
    zoo_figure(cells).savefig(folder / "zoo.png", dpi=110)
    return page


def _text(value: object) -> str:
    if value is None:
        return ""
    return json.dumps(value) if isinstance(value, dict) else str(value)


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
    parser.add_argument("--out", type=Path, required=True, help="folder to write into")
    parser.add_argument("--force", action="store_true", help="write into a folder that is not empty")
    given = parser.parse_args(None if arguments is None else list(arguments))
    try:
        chosen = (
            quick_cases()
            if given.quick
            else cases(_bodies(given.bodies), _seeds(given.seeds), scaled=not given.unscaled)
        )
        with output_folder(given.out, force=given.force) as folder:
            sys.stdout.write(write_results(run_all(chosen), folder))
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
