"""Real breathing lungs: the filter and a spline estimate inner landmarks from landmarks on the convex hull.

    python -m experiments.studies.lungs FOLDER              # prints the table; --page writes it to docs/zoo.md

FOLDER has tables `case1.csv` and so on, with columns `landmark,phase,x_mm,y_mm,z_mm`. Phase 0 is at the end of
inhaling, the last phase at the end of exhaling. The page uses the landmarks of DIR-Lab [castillo2009], which are not
part of the repository. Each lung is a body without anchors. Latest figures: docs/zoo.md.
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
    """Run all methods on one lung; job: the lung, and one of `SEEN`."""
    lung, seen = job
    return inner_landmarks(lung, seen, LungConstants())


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study on a folder of landmarks, and print the table."""
    parser = study_options(__doc__, out=False, page="zoo.md")
    parser.add_argument("folder", type=Path, help="folder with case1.csv and so on")
    given = parser.parse_args(arguments)
    jobs = [(lung, seen) for seen in SEEN for lung in read_lungs(given.folder)]
    found: list[Inner] = runs_of(run, jobs, workers_for(len(jobs), chosen_workers(given)))
    page = markdown(errors_table(found), found)
    publish(given, page, {"lungs table": page})


if __name__ == "__main__":
    sys.exit(main())
