"""Worlds that differ from the stated scene: frequency of GO on a wrong estimate.

    python -m experiments.studies.faults.wrong_worlds --out FOLDER         # all rows; --page writes the table
    python -m experiments.studies.faults.wrong_worlds --out FOLDER --only "nothing" --seeds 3

SciPy's DOP853 computes the true motion of a poked and breathing body; a simulated tracker measures its marks. A live
session with a scripted clock estimates the target and gives advice at every frame. In each world one property differs
from the stated scene; properties that the scene does not state have their defaults. The study counts how often GO is
displayed, and how often the estimate is then wrong: the error exceeds 1 mm, and the truth is outside the 99.9 % region.
Latest figures: docs/faults.md.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from experiments.engine.workers import chosen_workers
from experiments.formats.outputs import write_whole
from experiments.studies.faults.wrong_worlds.bodies import BODIES
from experiments.studies.faults.wrong_worlds.rows import WORLDS
from experiments.studies.faults.wrong_worlds.run import run
from experiments.studies.faults.wrong_worlds.table import markdown, rows_of
from experiments.studies.grid import add_seeds, chosen, command, grid, kept_runs, publish, seeds_of, study_options


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Do the missing runs of the folder, and write the tables."""
    parser = study_options(__doc__, page="faults.md")
    parser.add_argument("--only", action="append", default=[], help="name of a row; repeat for several; default: all")
    parser.add_argument("--bodies", action="append", default=[], help=f"of {', '.join(BODIES)}; again for more")
    parser.add_argument("--seconds", type=float, help="length of a run [s]; default: 12, for the breast 8")
    add_seeds(parser, 20, 0)
    given = parser.parse_args(arguments)
    worlds, bodies = chosen("--only", given.only, WORLDS), chosen("--bodies", given.bodies, BODIES)
    axes = {"duration_s": [given.seconds]} if given.seconds else {}
    # worlds vary fastest: most worlds of a body and a seed have the same truth, which is cached
    cases = grid(**axes, seed=seeds_of(given), body=bodies, world=worlds)
    rows = rows_of(kept_runs(run, cases, given.out, chosen_workers(given)))
    summary = markdown(rows)
    write_whole(given.out / "wrong_worlds.csv", rows.to_csv(index=False))
    write_whole(given.out / "wrong_worlds.md", summary)
    publish(given, summary, {"wrong worlds": summary})


if __name__ == "__main__":
    sys.exit(main())
