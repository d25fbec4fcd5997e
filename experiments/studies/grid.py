"""Functions that all studies share: grids of cases, runs, options of the command, and output."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from itertools import product
from pathlib import Path
from typing import Any

from experiments.engine.executor import results
from experiments.engine.progress import progress
from experiments.engine.runs import Case, Work
from experiments.engine.study import Study, run_study
from experiments.engine.workers import Workers, workers_for
from experiments.errors import InputError
from experiments.formats.outputs import write_whole
from experiments.formats.page import rewrite_page

DOCS = Path(__file__).parents[2] / "docs"

Main = Callable[[Sequence[str] | None], int | None]


def grid(**axes: Iterable[Any]) -> list[dict[str, Any]]:
    """A case for each combination of values of the axes; the last axis changes fastest."""
    return [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]


def study_options(
    doc: str | None, *, out: bool = True, page: str = "", seeds: tuple[int, int] | None = None, runs: str = "--seeds"
) -> argparse.ArgumentParser:
    """Parser of a study's options.

    doc: docstring of the study's module; its first line becomes the description
    out: whether there is an option --out
    page: page of docs/ whose tables the option --page rewrites; if empty, there is no such option
    seeds: default number of runs and default first seed; if None, there are no such options
    runs: name of the option for the number of runs
    """
    text = doc or ""
    command = re.search(r"python -m [\w.]+", text)
    parser = argparse.ArgumentParser(prog=command and command[0], description=text.split("\n", maxsplit=1)[0])
    if out:
        parser.add_argument("--out", type=Path, required=True, help="output folder; run again to continue")
    if page:
        own = DOCS / page
        parser.add_argument("--page", action="store_const", const=own, help=f"rewrite the tables of docs/{page}")
    if seeds is not None:
        n, first = seeds
        words = "runs of each case; default: %(default)s"
        parser.add_argument(runs, dest="n_seeds", type=one_or_more, default=n, help=words)
        parser.add_argument("--first-seed", type=int, default=first, help="first seed; default: %(default)s")
    parser.add_argument("--processes", type=one_or_more, help="number of processes; default: one per core")
    parser.add_argument("--scheduler", help="address of a Dask scheduler, in place of this machine")
    return parser


def one_or_more(text: str) -> int:
    """The number in an option's text. Raises ArgumentTypeError unless it is a whole number of 1 or more."""
    if not text.isdigit() or not int(text):
        raise argparse.ArgumentTypeError(f"expected 1 or more, found {text}")
    return int(text)


def seeds_of(given: argparse.Namespace) -> range:
    """The seeds from the options of `study_options`."""
    return range(given.first_seed, given.first_seed + given.n_seeds)


def chosen(option: str, names: Sequence[str], known: Iterable[str]) -> list[str]:
    """The names given with an option, or all known names if none is given. Raises InputError for an unknown name."""
    every = list(known)
    for name in names:
        if name not in every:
            raise InputError.at(option, f"one of {', '.join(every)}", name)
    return list(names) or every


def kept_runs(work: Work, cases: Sequence[Case], folder: Path, given: argparse.Namespace) -> Study:
    """Do the runs that the folder lacks, and store them there; `given` has the options of `study_options`."""
    with progress() as stage:
        return run_study(work, cases, folder, Workers(given.processes, given.scheduler), stage(folder.name))


def runs_of(work: Work, jobs: Sequence[Any], given: argparse.Namespace | None = None) -> list[Any]:
    """Do runs without storing them; returns results in the order of the jobs. Raises InputError, RunsFailedError.

    given: options of `study_options`; None: one process per core
    """
    wanted = Workers() if given is None else Workers(given.processes, given.scheduler)
    with progress() as stage:
        return results(work, jobs, workers_for(len(jobs), wanted), stage("runs"))


def command(main: Main) -> Callable[..., int]:
    """Decorator of a study's main function. After an InputError, it prints one line and returns the exit code 2."""

    @wraps(main)
    def coded(arguments: Sequence[str] | None = None) -> int:
        try:
            return main(arguments) or 0
        except InputError as error:
            sys.stderr.write(f"{error}\n")
            return 2

    return coded


def publish(given: argparse.Namespace, text: str, parts: Mapping[str, str], file: Path | None = None) -> None:
    """Print a text, and write it to `file` unless that is None. With --page, also rewrite the study's page.

    parts: new text of each part of the page, by the name of the part
    """
    if file is not None:
        write_whole(file, text)
    sys.stdout.write(text)
    if given.page is not None:
        rewrite_page(given.page, parts)


def print_figures(label: str, figures: Mapping[str, float], digits: int = 3) -> None:
    """Print a line with a label and all figures with their names."""
    columns = "  ".join(f"{name} {value:.{digits}g}" for name, value in figures.items() if not isinstance(value, str))
    sys.stdout.write(f"{label}{columns}\n")
    sys.stdout.flush()
