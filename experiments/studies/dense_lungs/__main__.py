"""Dense landmarks of breathing lungs: deep landmarks are estimated from marks near the surface.

    python -m experiments.studies.dense_lungs FOLDER --out DIR    # --page writes the table to docs/zoo.md

FOLDER has a table for each person with the columns `landmark,x0_mm,y0_mm,z0_mm,x1_mm,y1_mm,z1_mm`: first positions at
the end of inhaling, then positions at the end of exhaling. The page uses data of [fu2019], which are not part of the
repository. DIR gets summary.json, rows.csv and table.md. Latest figures: docs/zoo.md.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimators import normalised_error_squared
from experiments.engine.workers import chosen_workers, workers_for
from experiments.errors import InputError
from experiments.formats.outputs import output_folder, write_whole
from experiments.studies.dense_lungs.data import WHERE, Lung, read_lungs
from experiments.studies.dense_lungs.methods import METHODS, DenseConstants, Task
from experiments.studies.dense_lungs.table import COUNTS, Run, flat, markdown, summary
from experiments.studies.grid import command, grid, publish, runs_of, study_options


def run(job: tuple[Lung, str, int, DenseConstants]) -> Run:
    """Run all methods; job: lung, place of the marks (one of `WHERE`), number of marks, constants."""
    lung, where, n, constants = job
    task = Task(lung, lung.marks(n, where), constants)
    truth = lung.exhaled[lung.hidden]
    errors = {"none": np.linalg.norm(task.wanted - truth, axis=1)}
    nees, failures = {}, {}
    for name, method in METHODS.items():
        try:
            found = method(task)
        except Exception as error:  # any exception that a method raises is a result of the study
            failures[name] = f"{type(error).__name__}: {error}"
            continue
        errors[name] = np.linalg.norm(found.means - truth, axis=1)
        if found.covs is not None:  # the position with which it is compared has an error, too
            read = found.covs + constants.scatter_m**2 * np.eye(3)
            nees[name] = normalised_error_squared(found.means - truth, read)
    return Run(lung.name, where, n, errors, nees, failures)


@command
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study on a folder of tables, and write the results; returns 1 if a method failed."""
    parser = study_options(__doc__, out=False, page="zoo.md")
    parser.add_argument("folder", type=Path, help="folder of landmark tables, one for each person")
    parser.add_argument("--out", type=Path, required=True, help="output folder, new or empty")
    parser.add_argument("--stiffness-factor", type=float, default=1.0, help="factor on all stiffnesses: %(default)s")
    given = parser.parse_args(arguments)
    constants, factor = DenseConstants(), given.stiffness_factor
    if not 0.0 < factor < np.inf:
        raise InputError.at("--stiffness-factor", "a finite number above 0", f"{factor:g}")
    body = replace(constants.body, strand_n=factor * constants.body.strand_n)
    with output_folder(given.out, inputs=[given.folder]) as folder:
        lungs = read_lungs(given.folder)
        cases = grid(where=WHERE, marks=COUNTS, lung=lungs)
        jobs = [(case["lung"], case["where"], case["marks"], replace(constants, body=body)) for case in cases]
        runs: list[Run] = runs_of(run, jobs, workers_for(len(jobs), chosen_workers(given)))
        rows = summary(runs)
        page = markdown(rows)
        content = {"stiffness_factor": factor, "lungs": [lung.name for lung in lungs], "rows": rows}
        write_whole(folder / "summary.json", json.dumps(content, indent=2) + "\n")
        write_whole(folder / "rows.csv", flat(rows).to_csv(index=False))
        write_whole(folder / "table.md", page)
    publish(given, page, {"dense lungs table": page})
    failed = [(one, name, why) for one in runs for name, why in one.failures.items()]
    for one, name, why in failed:
        sys.stderr.write(f"{one.lung}, {one.marks} marks, {one.where}: {name}: {why}\n")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
