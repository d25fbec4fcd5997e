"""What all studies share: grids of cases, runs, options of the command, and output."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd

from experiments.engine.executor import results
from experiments.engine.progress import run_bar
from experiments.engine.runs import Case, Work
from experiments.engine.study import run_study
from experiments.engine.workers import Workers, add_worker_options, one_or_more
from experiments.errors import InputError
from experiments.formats.page import rewrite_page

DOCS = Path(__file__).parents[2] / "docs"

Main = Callable[[Sequence[str] | None], int | None]


def grid(**axes: Iterable[Any]) -> list[dict[str, Any]]:
    """A case for each combination of values of the axes; the last axis changes fastest."""
    return [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]


def study_options(doc: str | None, *, out: bool = True, page: str = "") -> argparse.ArgumentParser:
    """Parser of a study's options.

    doc: docstring of the study's module; its first line becomes the description
    out: whether the option --out is added; page: page of docs/ whose tables --page rewrites, empty for none
    """
    text = doc or ""
    command = re.search(r"python -m [\w.]+", text)
    parser = argparse.ArgumentParser(prog=command and command[0], description=text.split("\n", maxsplit=1)[0])
    if out:
        parser.add_argument("--out", type=Path, required=True, help="output folder; run again to continue")
    if page:
        own = DOCS / page
        parser.add_argument("--page", action="store_const", const=own, help=f"rewrite the tables of docs/{page}")
    add_worker_options(parser)
    return parser


def add_seeds(parser: argparse.ArgumentParser, n: int, first: int, *, runs: str = "--seeds") -> None:
    """Add the options that `seeds_of` reads: the number of seeds, and `--first-seed`; runs: name of the former."""
    parser.add_argument(
        runs, dest="n_seeds", type=one_or_more, default=n, help="runs of each case; default: %(default)s"
    )
    parser.add_argument("--first-seed", type=int, default=first, help="first seed; default: %(default)s")


def seeds_of(given: argparse.Namespace) -> range:
    """The seeds from the options of `add_seeds`."""
    return range(given.first_seed, given.first_seed + given.n_seeds)


def chosen(option: str, names: Sequence[str], known: Iterable[str]) -> list[str]:
    """The names that an option states, or all known names if it states none. Raises InputError for other names."""
    every = list(known)
    for name in names:
        if name not in every:
            raise InputError.at(option, f"one of {', '.join(every)}", name)
    return list(names) or every


def kept_runs(work: Work, cases: Sequence[Case], folder: Path, workers: Workers) -> pd.DataFrame:
    """Do the runs that the folder lacks, and store them there; returns all rows. Raises InputError, RunsFailedError."""
    with run_bar(folder.name) as advance:
        return run_study(work, cases, folder, workers, advance).checked()


def runs_of(work: Work, jobs: Sequence[Any], workers: Workers) -> list[Any]:
    """Do runs without storing them; returns results in the order of the jobs. Raises InputError, RunsFailedError."""
    with run_bar("runs") as advance:
        return results(work, jobs, workers, advance)


def command(main: Main) -> Callable[..., int]:
    """Decorator of a study's main function. It prints an InputError as one line, and returns the exit code 2."""

    @wraps(main)
    def coded(arguments: Sequence[str] | None = None) -> int:
        try:
            return main(arguments) or 0
        except InputError as error:
            sys.stderr.write(f"{error}\n")
            return 2

    return coded


def publish(given: argparse.Namespace, text: str, parts: Mapping[str, str]) -> None:
    """Print a text. With `--page`, also rewrite parts of the study's page; parts: new text by the part's name."""
    sys.stdout.write(text)
    if given.page is not None:
        rewrite_page(given.page, parts)


def print_figures(label: str, figures: Mapping[str, float], digits: int = 3) -> None:
    """Print a line with a label and all figures with their names."""
    columns = "  ".join(f"{name} {value:.{digits}g}" for name, value in figures.items() if not isinstance(value, str))
    sys.stdout.write(f"{label}{columns}\n")
    sys.stdout.flush()
