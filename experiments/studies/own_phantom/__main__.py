"""The steps of a new user on three phantoms, and the reliability of the resulting probabilities.

    python -m experiments.studies.own_phantom --out FOLDER            # steps, then insertions; prints both tables
    python -m experiments.studies.own_phantom --out FOLDER --runs 2   # fewer recordings to insert into

For each phantom `softaim new` creates a project; the commands of its STEPS.md are run, each in a separate process,
and timed. Then the project's scenario is simulated again with seeds that were not used before, filmed as before, and
the tuned scene advises the project's needle in each recording, four times per second. Predicted is the probability of
a hit, observed the share of needles that hit the true target (`experiments.pipeline.advise.observed_hits`).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence

import pandas as pd

from experiments.engine.workers import chosen_workers
from experiments.formats.outputs import output_folder, write_whole
from experiments.studies.grid import add_seeds, chosen, command, grid, kept_runs, seeds_of, study_options
from experiments.studies.own_phantom.steps import PHANTOMS, insertions, reliability_table, stepped, times_table


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Do the missing steps of the folder, then the insertions."""
    parser = study_options(__doc__)
    parser.add_argument("--phantoms", default="0,1,2", help="which: %(default)s")
    add_seeds(parser, 56, 7100, runs="--runs")
    given = parser.parse_args(arguments)
    known = {str(k): name for k, name in enumerate(PHANTOMS)}
    rows, cases = [], []
    for number in chosen("--phantoms", given.phantoms.split(","), known):
        name = known[number]
        folder = given.out / name.split(",")[0].replace(" ", "-")
        timed = given.out / f"{folder.name}.json"
        if not timed.is_file():
            with output_folder(folder) as project:
                steps = stepped(name, project.resolve())
            write_whole(timed, json.dumps(steps))
        rows += json.loads(timed.read_text(encoding="utf-8"))
        cases += grid(phantom=[name], project=[str(folder.resolve())], seed=seeds_of(given))
    found = kept_runs(insertions, cases, given.out / "runs", chosen_workers(given))
    times, reliability = times_table(pd.DataFrame(rows)), reliability_table(found)
    sys.stdout.write(f"{times}\n{reliability}")


if __name__ == "__main__":
    sys.exit(main())
