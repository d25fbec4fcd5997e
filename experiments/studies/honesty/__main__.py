"""Coverage of the target by how coarse the marks are, with constants and noise stated as they are.

    python -m experiments.studies.honesty --out FOLDER
    python -m experiments.studies.honesty --out FOLDER --bodies "four masses" --seeds 3

Truth by DOP853; marks with Gaussian noise of 0.3 to 30 mm an axis at 30 frames/s, stated as it is, ten times as coarse
and three times as fine; nothing moves the body, or a breath of 1, 2 or 4 m/s² over 3 to 6 s, pokes of 5 m/s², or both.
Frames count from the second on. Last figures, four masses, three seeds of 20 s: with nothing or pokes 91 to 100 % are
covered; with a breath, marks of 1 mm 98 to 100 %, 4.14 mm 84 to 94, 10 mm 56 to 90, 30 mm 33 to 83: too few.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from estimators import METHODS
from experiments.engine.progress import run_bar
from experiments.engine.study import run_study
from experiments.engine.workers import add_worker_options, chosen_workers
from experiments.errors import InputError
from experiments.formats.outputs import write_whole
from experiments.pipeline.line import FILTER
from experiments.studies.faults.wrong_worlds.bodies import BODIES
from experiments.studies.honesty.run import PUSHES, run

SD_M = (0.3e-3, 1e-3, 4.14e-3, 10e-3, 30e-3)
STATED = (1.0, 10.0, 1.0 / 3.0)
"""The marks' standard deviation as stated, by the true one."""

CELL = ["method", "body", "pushes", "sd_m", "stated"]


def cells_of(runs: pd.DataFrame) -> pd.DataFrame:
    """A row for each cell: share covered and wrong, of frames that may guide; medians over the runs of the rest."""
    rows = []
    for cell, own in runs.groupby(CELL, sort=False):
        seen = int((own["frames"] - own["lost"]).sum())
        rows.append(
            {
                **dict(zip(CELL, cell, strict=True)),
                "seeds": len(own),
                "frames": seen,
                "covered": own["covered"].sum() / seen if seen else float("nan"),
                "wrong": own["wrong"].sum() / seen if seen else float("nan"),
                **{key: float(own[key].median()) for key in ("nees", "error_mm", "sd_mm")},
            }
        )
    return pd.DataFrame(rows)


def main(arguments: Iterable[str] | None = None) -> int:
    """Do the runs that the folder does not have yet, and write cells.csv; the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m experiments.studies.honesty", description=(__doc__ or "").split("\n", maxsplit=1)[0]
    )
    parser.add_argument("--out", type=Path, required=True, help="a study that was ended goes on")
    parser.add_argument(
        "--method", default=FILTER, choices=[FILTER, *METHODS], help="%(default)s, or one to compare with"
    )
    parser.add_argument("--bodies", action="append", default=[], choices=list(BODIES), help="again for more")
    parser.add_argument("--pushes", action="append", default=[], choices=list(PUSHES), help="again for more")
    parser.add_argument("--seeds", type=int, default=20, help="runs of each cell: %(default)s")
    parser.add_argument("--first-seed", type=int, default=0, help="of them: %(default)s")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each run: %(default)s")
    add_worker_options(parser)
    given = parser.parse_args(None if arguments is None else list(arguments))
    cases = [
        {"method": given.method, "body": body, "pushes": pushes, "seed": seed, "sd_m": sd_m, "stated": stated}
        | {"duration_s": given.seconds}
        for seed in range(given.first_seed, given.first_seed + given.seeds)
        for body in given.bodies or BODIES
        for pushes in given.pushes or PUSHES
        for sd_m in SD_M
        for stated in STATED
    ]
    try:
        with run_bar("honesty") as advance:
            found = run_study(run, cases, given.out, chosen_workers(given), advance).checked()
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    cells = cells_of(found)
    write_whole(given.out / "cells.csv", cells.to_csv(index=False))
    sys.stdout.write(cells.to_string(index=False, float_format=lambda x: f"{x:.3g}") + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
