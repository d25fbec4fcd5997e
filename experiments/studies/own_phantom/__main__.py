"""The steps of a new user on three phantoms, and whether the probabilities that come out of them come true.

    python -m experiments.studies.own_phantom --out FOLDER            # steps, then insertions; --page writes the tables
    python -m experiments.studies.own_phantom --out FOLDER --runs 2   # fewer recordings to insert into

For each phantom `softaim new` makes a project; the commands of its STEPS.md are typed, each in a process of its own,
and timed. Then the project's scenario is simulated anew with seeds that nobody has looked at, filmed as before, and
the tuned scene advises the project's needle in each recording, four times a second. Told is the probability of a hit,
true is the share of needles that hit the true target (`experiments.pipeline.advise.came_true`). Last figures:
docs/tutorial.md.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from experiments.engine.progress import run_bar
from experiments.engine.study import run_study
from experiments.engine.workers import add_worker_options, chosen_workers
from experiments.errors import InputError
from experiments.formats.outputs import output_folder, write_whole
from experiments.formats.page import rewrite_page
from experiments.studies.own_phantom.insertions import insertions, reliability_table
from experiments.studies.own_phantom.steps import PHANTOMS, stepped, times_table

FIRST_SEED = 7100
N_RUNS = 56

PAGE = Path(__file__).parents[3] / "docs" / "tutorial.md"


def _phantoms(text: str) -> list[str]:
    known = {str(k): name for k, name in enumerate(PHANTOMS)}
    for number in text.split(","):
        if number not in known:
            raise InputError.at("--phantoms", f"numbers among {','.join(known)}", number)
    return [known[number] for number in text.split(",")]


def main(arguments: Iterable[str] | None = None) -> int:
    """Do the steps that the folder does not have yet, then the insertions; the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m experiments.studies.own_phantom", description=(__doc__ or "").split("\n", maxsplit=1)[0]
    )
    parser.add_argument("--out", type=Path, required=True, help="a study that was ended goes on")
    parser.add_argument("--runs", type=int, default=N_RUNS, help="recordings of each phantom: %(default)s")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED, help="of them: %(default)s")
    parser.add_argument("--phantoms", default="0,1,2", help="which: %(default)s")
    parser.add_argument("--page", action="store_true", help="rewrite the tables of docs/tutorial.md")
    add_worker_options(parser)
    given = parser.parse_args(None if arguments is None else list(arguments))
    try:
        rows, cases = [], []
        for name in _phantoms(given.phantoms):
            folder = given.out / name.split(",")[0].replace(" ", "-")
            timed = given.out / f"{folder.name}.json"
            if not timed.is_file():
                with output_folder(folder) as project:
                    steps = stepped(name, project.resolve())
                write_whole(timed, json.dumps(steps))
            rows += json.loads(timed.read_text(encoding="utf-8"))
            cases += [
                {"phantom": name, "project": str(folder.resolve()), "seed": given.first_seed + k}
                for k in range(given.runs)
            ]
        with run_bar("insertions") as advance:
            found = run_study(insertions, cases, given.out / "runs", chosen_workers(given), advance).checked()
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    times, reliability = times_table(pd.DataFrame(rows)), reliability_table(found)
    sys.stdout.write(f"{times}\n{reliability}")
    if given.page:
        rewrite_page(PAGE, {"steps table": times, "insertions table": reliability})
    return 0


if __name__ == "__main__":
    sys.exit(main())
