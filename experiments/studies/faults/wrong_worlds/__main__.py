"""Worlds that differ from what the scene states: how often GO is shown on a wrong estimate.

    python -m experiments.studies.faults.wrong_worlds --out FOLDER         # all rows; --page writes the table
    python -m experiments.studies.faults.wrong_worlds --out FOLDER --only "nothing" --seeds 3

The truth of a body that is poked and breathes is SciPy's DOP853; a tracker sends its marks, and a live session
estimates the target and advises a needle at every frame, by a script's own clock. One thing is not as the scene states,
and what the scene leaves unsaid is at its defaults. Counted are moments of GO, and those on a wrong estimate: the truth
outside of the region of 99.9 % and more than 1 mm off. A world whose keys scene files do not have yet is left out. Last
figures: docs/faults.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from experiments.engine.progress import run_bar
from experiments.engine.study import run_study
from experiments.engine.workers import add_worker_options, chosen_workers
from experiments.errors import InputError
from experiments.formats.outputs import write_whole
from experiments.formats.page import rewrite_page
from experiments.studies.faults.wrong_worlds.bodies import BODIES
from experiments.studies.faults.wrong_worlds.rows import WORLDS
from experiments.studies.faults.wrong_worlds.run import run
from experiments.studies.faults.wrong_worlds.table import markdown, rows_of

PAGE = Path(__file__).parents[4] / "docs" / "faults.md"
TABLE, SUMMARY = "wrong_worlds.csv", "wrong_worlds.md"


def _chosen(option: str, given: Sequence[str], known: Sequence[str]) -> list[str]:
    for name in given:
        if name not in known:
            raise InputError.at(option, f"one of {', '.join(known)}", name)
    return list(given) or list(known)


def main(arguments: Iterable[str] | None = None) -> int:
    """Do the runs that the folder does not have yet, and write the tables; the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m experiments.studies.faults.wrong_worlds", description=(__doc__ or "").split("\n", maxsplit=1)[0]
    )
    parser.add_argument("--out", type=Path, required=True, help="a study that was ended goes on")
    parser.add_argument("--only", action="append", default=[], help="a row's name; again for more; default: all")
    parser.add_argument("--bodies", action="append", default=[], help=f"of {', '.join(BODIES)}; again for more")
    parser.add_argument("--seeds", type=int, default=20, help="runs of each row and body: %(default)s")
    parser.add_argument("--first-seed", type=int, default=0, help="of them: %(default)s")
    parser.add_argument("--seconds", type=float, help="of each run; default: 12, of the breast 8")
    parser.add_argument("--page", action="store_true", help="rewrite the table of docs/faults.md")
    add_worker_options(parser)
    given = parser.parse_args(None if arguments is None else list(arguments))
    try:
        names = _chosen("--only", given.only, [world.name for world in WORLDS])
        bodies = _chosen("--bodies", given.bodies, list(BODIES))
        worlds = [world.name for world in WORLDS if world.name in names and world.is_supported]
        seeds = range(given.first_seed, given.first_seed + given.seeds)
        # worlds last: most of a body and a seed have the same truth, which is kept
        cases = [
            {"body": body, "seed": seed, "world": world, **({"duration_s": given.seconds} if given.seconds else {})}
            for seed in seeds
            for body in bodies
            for world in worlds
        ]
        with run_bar("wrong worlds") as advance:
            found = run_study(run, cases, given.out, chosen_workers(given), advance).checked()
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    rows = rows_of(found)
    summary = markdown(rows)
    write_whole(given.out / TABLE, rows.to_csv(index=False))
    write_whole(given.out / SUMMARY, summary)
    if given.page:
        rewrite_page(PAGE, {"wrong worlds": summary})
    sys.stdout.write(summary)
    return 0


if __name__ == "__main__":
    sys.exit(main())
