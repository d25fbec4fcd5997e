"""Real breathing lungs: inner landmarks are estimated from those on the hull, and by a thin-plate spline.

    python -m experiments.studies.lungs FOLDER              # prints the table; --page writes it to docs/zoo.md

FOLDER has `case1.csv` and others, `landmark,phase,x_mm,y_mm,z_mm`, phase 0 at the end of inhaling and the last one at
the end of exhaling, such as the landmarks of DIR-Lab [castillo2009]; they are not part of the repository. Each lung is
a body without anchors. Last figures: docs/zoo.md.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from experiments.engine.workers import chosen_workers, workers_for
from experiments.studies.grid import command, publish, runs_of, study_options
from experiments.studies.lungs.estimate import SEEN, Inner, errors_table, inner_landmarks
from experiments.studies.lungs.landmarks import Lung, read_lungs
from experiments.studies.lungs.model import LungConstants
from experiments.studies.lungs.table import markdown


def run(job: tuple[Lung, str]) -> Inner:
    """Estimate one lung from a number of visible landmarks, named in `SEEN`, with the constants of all lungs."""
    lung, seen = job
    return inner_landmarks(lung, seen, LungConstants())


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table of a folder of landmarks."""
    parser = study_options(__doc__, out=False, page="zoo.md")
    parser.add_argument("folder", type=Path, help="folder with case1.csv and so on")
    given = parser.parse_args(arguments)
    jobs = [(lung, seen) for seen in SEEN for lung in read_lungs(given.folder)]
    found: list[Inner] = runs_of(run, jobs, workers_for(len(jobs), chosen_workers(given)))
    page = markdown(errors_table(found), found)
    publish(given, page, {"lungs table": page})


if __name__ == "__main__":
    sys.exit(main())
