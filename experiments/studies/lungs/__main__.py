"""Real breathing lungs: landmarks inside them estimated from those on their hull, against a thin-plate spline.

    python -m experiments.studies.lungs FOLDER              # prints the table
    python -m experiments.studies.lungs FOLDER --out OUT    # and writes table.md, errors.csv and lungs.png

FOLDER has `case1.csv` and others, `landmark,phase,x_mm,y_mm,z_mm`, phase 0 at the end of inhaling and the last one at
the end of exhaling, such as the landmarks of DIR-Lab [castillo2009]; they are not part of the repository. Each lung is
a body without anchors. Last figures: docs/zoo.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

from experiments.engine.executor import results
from experiments.engine.progress import run_bar
from experiments.engine.workers import add_worker_options, chosen_workers, workers_for
from experiments.errors import InputError
from experiments.formats.outputs import output_folder, write_whole
from experiments.formats.page import rewrite_page
from experiments.plots.style import saved
from experiments.studies.lungs.estimate import SEEN, Inner, errors_table, inner_landmarks
from experiments.studies.lungs.landmarks import Lung, read_lungs
from experiments.studies.lungs.model import LungConstants
from experiments.studies.lungs.table import lungs_figure, markdown
from experiments.studies.zoo.table import PAGE


def run(job: tuple[Lung, str]) -> Inner:
    """One lung with so many of its landmarks seen, `SEEN`, by the constants of all lungs."""
    lung, seen = job
    return inner_landmarks(lung, seen, LungConstants())


def main(arguments: Iterable[str] | None = None) -> int:
    """Print the table of a folder of landmarks; the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m experiments.studies.lungs", description=(__doc__ or "").split("\n", maxsplit=1)[0]
    )
    parser.add_argument("folder", type=Path, help="of case1.csv and others")
    parser.add_argument("--out", type=Path, help="folder to write table.md, errors.csv and lungs.png into")
    parser.add_argument("--force", action="store_true", help="write into a folder that is not empty")
    parser.add_argument("--page", action="store_true", help="rewrite the table of docs/zoo.md")
    add_worker_options(parser)
    given = parser.parse_args(None if arguments is None else list(arguments))
    try:
        jobs = [(lung, seen) for seen in SEEN for lung in read_lungs(given.folder)]
        with run_bar("lungs") as advance:
            found: list[Inner] = results(run, jobs, workers_for(len(jobs), chosen_workers(given)), advance)
        errors = errors_table(found)
        page = markdown(errors, found)
        sys.stdout.write(page)
        if given.page:
            rewrite_page(PAGE, {"lungs table": page})
        if given.out is not None:
            with output_folder(given.out, force=given.force, inputs=[given.folder]) as folder:
                write_whole(folder / "lungs.png", saved(lungs_figure(errors), "png"))
                write_whole(folder / "errors.csv", errors.to_csv(index=False))
                write_whole(folder / "table.md", page)
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
