"""What each mechanism of the filter is worth: the same runs with one of them turned off at a time.

    python -m experiments.studies.ablation --out FOLDER --lungs LUNGS      # --page writes docs/ablation.md
    python -m experiments.studies.ablation --out FOLDER --only Scales --only field --together
    python -m experiments.studies.ablation --out FOLDER --quick

LUNGS is a folder as for `experiments.studies.lungs`. A study that was ended goes on in its folder, seed by seed.
Last figures: docs/ablation.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from experiments.engine.progress import run_bar
from experiments.engine.study import run_study
from experiments.engine.workers import add_worker_options, chosen_workers
from experiments.errors import InputError
from experiments.formats.outputs import write_whole
from experiments.formats.page import rewrite_page
from experiments.studies.ablation.run import run
from experiments.studies.ablation.switches import SWITCHES, TOGETHER, WHOLE
from experiments.studies.ablation.table import PAGE, markdown

FIRST_SEED = 700
"""Seeds from here on are for development: no published figure is of them."""

TROUBLES = ("camera", "names", "outliers", "gaps", "stated", "blows", "tenth")


def _honest(body: str, sd_mm: float) -> dict[str, Any]:
    return {"body": body, "pushes": "both", "sd_m": 1e-3 * sd_mm}


BODIES: dict[str, tuple[str, str, dict[str, Any], float]] = {
    "phantom, wrong": ("soft", "zoo", {"body": "phantom", "constants": "wrong"}, 5.0),
    **{name: ("soft", "phantom", {"scenario": name, "trouble": ""}, 8.0) for name in ("quiet", "poked", "shoved")},
    **{f"poked, {name}": ("soft", "phantom", {"scenario": "poked", "trouble": name}, 8.0) for name in TROUBLES},
    "block27": ("stiff", "zoo", {"body": "block27"}, 2.5),
    "chain2": ("stiff", "zoo", {"body": "chain2"}, 2.0),
    "breast, 1 mm": ("stiff", "honesty", _honest("breast", 1.0), 2.5),
    "marks to 1 mm": ("soft", "honesty", _honest("four masses", 1.0), 7.0),
    "marks to 10 mm": ("soft", "honesty", _honest("four masses", 10.0), 7.0),
    "cable-fast": ("stiff", "zoo", {"body": "cable-fast"}, 2.0),
    "lung": ("stiff", "lungs", {"seen": "six"}, 0.0),
    "floating": ("stiff", "zoo", {"body": "floating"}, 2.0),
    "wrong springs": ("checked", "phantom", {"scenario": "quiet", "trouble": "check"}, 6.0),
    "marks to 4.14 mm": ("soft", "honesty", _honest("four masses", 4.14), 7.0),
    "chain3, size x 10": ("stiff", "zoo", {"body": "chain3", "size": 10.0}, 1.2),
}
"""By body its kind, as in `Switch`, the study that its run is of, what that takes, and how long it lasts [s]."""

QUICK_S = 1.0
"""Length of the recordings of the quick form [s]."""


def cases(names: Sequence[str], seeds: Iterable[int], lungs: Path | None, *, quick: bool) -> list[dict[str, Any]]:
    """The runs, switches innermost: those of one recording follow each other and share it."""
    given = {} if lungs is None else {"folder": str(lungs)}
    return [
        {"body": body, "seed": seed, "off": off, "study": study, "of": of | (given if study == "lungs" else {})}
        | {"seconds": QUICK_S if quick else seconds}
        for seed in seeds
        for body, (kind, study, of, seconds) in BODIES.items()
        if given or study != "lungs"
        for off in (WHOLE, *names)
        if off == WHOLE or any(kind in SWITCHES[name].kinds for name in off.split(TOGETHER))
    ]


def main(arguments: Iterable[str] | None = None) -> int:
    """Do the runs that the folder does not have yet, and write the table; the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m experiments.studies.ablation", description=(__doc__ or "").split("\n", maxsplit=1)[0]
    )
    parser.add_argument("--out", type=Path, required=True, help="a study that was ended goes on")
    parser.add_argument("--quick", action="store_true", help="a second of each body, one seed")
    parser.add_argument("--only", action="append", default=[], help="a mechanism; again for more; default: all")
    parser.add_argument("--together", action="store_true", help="turn these off together, not one at a time")
    parser.add_argument("--seeds", type=int, default=2, help=f"runs of each body, from {FIRST_SEED} on: %(default)s")
    parser.add_argument("--lungs", type=Path, help="folder of case1.csv and others; default: no lungs")
    parser.add_argument("--page", action="store_true", help="rewrite the tables of docs/ablation.md")
    add_worker_options(parser)
    given = parser.parse_args(None if arguments is None else list(arguments))
    try:
        for name in given.only:
            if name not in SWITCHES:
                raise InputError.at("--only", f"one of {', '.join(SWITCHES)}", name)
        names = given.only or list(SWITCHES)
        seeds = range(FIRST_SEED, FIRST_SEED + (1 if given.quick else given.seeds))
        todo = cases([TOGETHER.join(names)] if given.together else names, seeds, given.lungs, quick=given.quick)
        with run_bar("ablation") as advance:
            page = markdown(run_study(run, todo, given.out, chosen_workers(given), advance).checked())
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    write_whole(given.out / "table.md", page)
    sys.stdout.write(page)
    if given.page:
        rewrite_page(PAGE, {"ablation table": page})
    return 0


if __name__ == "__main__":
    sys.exit(main())
