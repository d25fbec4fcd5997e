"""Accuracy and consistency of the filter in runs on the phantom: the tables of docs/estimation-study.md.

    python -m experiments.studies.estimation.study --out study             # all parts: hours on two cores
    python -m experiments.studies.estimation.study hard --runs 10 --out study
    python -m experiments.studies.estimation.study --out study --page      # rewrite the tables of the page, too

The folder stores runs in `runs` and true motions in `truth`; an interrupted study continues there. SciPy's RK45
computes the true motion, which includes friction and tremor. In the scenario `poked`, half-sine forces act on one mass
at a time. In the scenario `shoved`, half-sine forces accelerate all outer masses simultaneously by 10 m/s², and the
target swings by 70 to 140 mm. The true tissue is always the phantom. Wrong constants occur only in the filter's model.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from dynamics import (
    HIDDEN,
    KINDS,
    OUTER,
    four_mass_phantom,
    independent_uncertainty,
    pack,
    parameters,
    scale_parameters,
)
from estimators import FilterSettings, ForceMode, TissueFilter, coverage, identify_constants, posterior_bound
from experiments.arrays import Floats
from experiments.engine.runs import Case
from experiments.formats.page import markdown_table
from experiments.studies.estimation.trials import EXACTLY, KNOTS_PER_S, Model, Outcome, Trial, run, seen, truth
from experiments.studies.grid import command, kept_runs, one_or_more, publish, study_options
from experiments.studies.grid import grid as cases_of

CONSTANT_SDS = dict.fromkeys(KINDS, 0.1) | {"rest_length": 0.01}
"""Relative standard deviations of the errors of constants, by kind: 1 % (2 mm) for rest lengths, 10 % for others."""

SCENARIOS = ("quiet", "poked", "shoved")
FAR_M = 0.04
"""Error of the hidden mass above which the error counts as large [m]."""

UNREPORTED_S = 0.5
"""Time within which a filter must report a large error [s]."""

TREMOR = 0.05
"""Amplitude density of the white-noise acceleration on each free node in the shipped scenarios [m/s²/sqrt(Hz)]."""

SECTIONS = {"from the first frame": 0, "after 2 s": 60}
"""Evaluated parts of a run: their names and their first frames. Each part lasts to the end of the run."""

Row = dict[str, float | int]


def row_of(outcome: Outcome) -> dict[str, Any]:
    """The figures of one run: mean errors [mm], coverage, mean NEES, and whether the error was ever large.

    diverged: whether the error exceeded FAR_M while the status was TRACKING, either throughout a period of
        UNREPORTED_S or in the last frame
    ever_far: whether the error exceeded FAR_M in any frame
    """
    is_far = outcome.filtered > FAR_M
    unreported = is_far & (np.array(outcome.status) == "TRACKING")
    return {
        "frames": len(is_far),
        "open_loop_mm": float(1e3 * outcome.open_loop.mean()),
        "filter_mm": float(1e3 * outcome.filtered.mean()),
        "coverage95": coverage(outcome.nees, 2),
        "nees": float(outcome.nees.mean()),
        "turned": outcome.turned,
        "diverged": bool(longest(outcome.times_s, unreported) >= UNREPORTED_S or unreported[-1]),
        "ever_far": bool(is_far.any()),
    }


def longest(times_s: Floats, wrong: NDArray[np.bool_]) -> float:
    """The longest duration [s] of consecutive frames in which `wrong` is true."""
    found, since = 0.0, None
    for time_s, now in zip(times_s, wrong, strict=True):
        since = (time_s if since is None else since) if now else None
        found = max(found, 0.0 if since is None else float(time_s - since))
    return found


def figures(runs: pd.DataFrame) -> Row:
    """Figures over several results of `row_of`; ratio: the filter's mean error divided by the open loop's."""

    def mean(column: str) -> float:
        return float(np.average(runs[column], weights=runs["frames"]))

    return {
        "runs": len(runs),
        "filter_mm": mean("filter_mm"),
        "ratio": mean("filter_mm") / mean("open_loop_mm"),
        "coverage95": mean("coverage95"),
        "nees": mean("nees"),
        "runs_diverged": int(runs["diverged"].sum()),
        "runs_ever_far": int(runs["ever_far"].sum()),
    }


def perturbed(seed: int, *, known: bool = False) -> Model:
    """A model whose constants have random errors; known: whether the model states the uncertainty of its constants."""
    network = four_mass_phantom()
    which = parameters(network)
    sds = np.array([CONSTANT_SDS[one.kind] for one in which])
    change = sds * np.random.default_rng([seed, 1]).normal(size=len(which))
    uncertainty = independent_uncertainty(which, sds) if known else None
    return Model(scale_parameters(network, which, change), uncertainty, FilterSettings())


def identified_rows(case: Case, cache: Path) -> list[dict[str, Any]]:
    """Identify the constants of a wrong model, then track all scenarios with the result; a row for each scenario.

    The identification uses 30 s of the scenario `poked` at 30 frames/s, with four marks accurate to 4.14 mm.
    """
    seed = case["seed"]
    model, trial = perturbed(seed), Trial("poked", seed + 500, duration_s=30.0)
    frames, _ = seen(trial, cache, np.random.default_rng([seed, 2]), (*OUTER, HIDDEN))
    found = identify_constants(model.network, frames, OUTER, HIDDEN, prior_sd=CONSTANT_SDS)
    known = replace(model, network=found.network, uncertainty=found.uncertainty)
    return [{"scenario": name, **row_of(run(Trial(name, seed), known, cache))} for name in SCENARIOS]


def by_scenario(runs: pd.DataFrame) -> dict[str, Row]:
    """Figures over the runs of all scenarios, and over the runs of each scenario."""
    return {"all": figures(runs)} | {str(name): figures(own) for name, own in runs.groupby("scenario", sort=False)}


def unidentified_row(case: Case, cache: Path) -> dict[str, Any]:
    """One run with wrong constants. The filter considers or ignores the uncertainty of the constants."""
    model = perturbed(case["seed"], known=case["uncertainty"] == "considered")
    return row_of(run(Trial(case["scenario"], case["seed"]), model, cache))


def by_uncertainty(runs: pd.DataFrame) -> dict[str, Row]:
    """Figures of the runs whose filter considers the uncertainty of constants, and of those whose filter ignores it."""
    return {f"{label}, all": figures(own) for label, own in runs.groupby("uncertainty", sort=False)}


def bound_row(case: Case, cache: Path) -> list[dict[str, Any]]:
    """A row for each of `SECTIONS` of a `quiet` run: the filter's mean square error, posterior Cramér-Rao bound."""
    network, trial = four_mass_phantom(), Trial("quiet", case["seed"])
    positions = truth(trial, cache)
    dt, every = 1.0 / KNOTS_PER_S, KNOTS_PER_S // trial.frames_per_s
    states = pack(positions, np.gradient(positions, dt, axis=0))
    mark = trial.mark_sd_m**2 * np.eye(2)
    seen_marks = [dict.fromkeys(OUTER, mark) if k % every == 0 else {} for k in range(len(states))]
    n = network.n_state
    start = TissueFilter(network, HIDDEN, OUTER, EXACTLY).process.prior(0.0)[1][0, :n, :n]
    tremor = ForceMode(white=TREMOR, poke=1e-9, lasting_s=1.0)
    times = dt * np.arange(len(states))
    place = network.coordinates(HIDDEN)
    covs = posterior_bound(network, states, times, seen_marks, tremor, start)[::every, place, place]
    squared, bound = run(trial, Model(), cache).filtered ** 2, np.trace(covs, axis1=1, axis2=2)
    return [
        {"from": label, "square_m2": float(squared[first:].mean()), "bound_m2": float(bound[first:].mean())}
        for label, first in SECTIONS.items()
    ]


def by_start(runs: pd.DataFrame) -> dict[str, Row]:
    """A row for each of `SECTIONS`: the filter's RMSE over all runs, posterior Cramér-Rao bound, and their ratio."""
    rows: dict[str, Row] = {}
    for label, own in runs.groupby("from", sort=False):
        rmse_mm, bound_mm = (1e3 * float(np.sqrt(own[key].mean())) for key in ("square_m2", "bound_m2"))
        rows[str(label)] = {"rmse_mm": rmse_mm, "bound_mm": bound_mm, "ratio": rmse_mm / bound_mm}
    return rows


def hard_trial(k: int) -> Trial:
    """A run of the part `hard` with random frame rate, noise, and strength of forces; 30 % of the marks are lost."""
    rng = np.random.default_rng([k, 3])
    return Trial(
        "poked" if k % 2 else "shoved",
        5000 + k,
        duration_s=6.0,
        frames_per_s=int(rng.choice([5, 10, 15, 30, 60, 120])),
        mark_sd_m=float(np.exp(rng.uniform(np.log(0.0005), np.log(0.008)))),
        strength=float(rng.choice([1.0, 1.25, 1.5])),
        lost=0.3,
    )


def hard_row(case: Case, cache: Path) -> dict[str, Any]:
    """The figures of a run of the part `hard`."""
    return row_of(run(hard_trial(case["seed"]), Model(), cache))


def by_turn(runs: pd.DataFrame) -> dict[str, Row]:
    """Figures of the runs in which a spring turned over (see `trials.turned`), and of the other runs."""
    parts = {"upright": runs[~runs["turned"]], "turned over": runs[runs["turned"]]}
    return {label: figures(own) for label, own in parts.items() if len(own)}


USUAL = {"filter [mm]": "{filter_mm:.2f}", "ratio": "{ratio:.3f}", "coverage": "{coverage95:.1%}", "NEES": "{nees:.2f}"}
BOUND = {"filter RMSE [mm]": "{rmse_mm:.3f}", "bound [mm]": "{bound_mm:.3f}", "ratio": "{ratio:.3f}"}
HARD = {"diverged": "{runs_diverged}/{runs}", "over 40 mm": "{runs_ever_far}/{runs}", "coverage": "{coverage95:.1%}"}
"""Columns of a table: headings, and format strings for the figures of a row."""


@dataclass(frozen=True, slots=True)
class Part:
    """One table of the page.

    work: function that does a run; rows: function that computes labelled rows of the table from all runs
    columns: heading and format string of each column; axes: values of all keys of a case except the seed
    more: factor by which the number of runs is multiplied; first: first seed of the runs
    """

    work: Callable[..., Any]
    rows: Callable[[pd.DataFrame], dict[str, Row]]
    columns: Mapping[str, str]
    axes: Mapping[str, Sequence[str]]
    more: int = 1
    first: int = 100

    def table(self, runs: pd.DataFrame) -> str:
        """The table in Markdown from these runs."""
        cells = [
            [label, *(cell.format(**row) for cell in self.columns.values())] for label, row in self.rows(runs).items()
        ]
        return markdown_table(["", *self.columns], cells)


PARTS = {
    "identified": Part(identified_rows, by_scenario, USUAL, {}),
    "unidentified": Part(
        unidentified_row, by_uncertainty, USUAL, {"uncertainty": ("considered", "ignored"), "scenario": SCENARIOS}
    ),
    "bound": Part(bound_row, by_start, BOUND, {}),
    "hard": Part(hard_row, by_turn, HARD, {}, more=10, first=0),
}


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Run the named parts, or all, and print their tables."""
    parser = study_options(__doc__, page="estimation-study.md")
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], help="parts of the study; default: all")
    parser.add_argument("--runs", type=one_or_more, default=100)
    given = parser.parse_args(arguments)
    cache = given.out / "truth"
    cache.mkdir(parents=True, exist_ok=True)
    tables = {}
    for name in given.parts or PARTS:
        part = PARTS[name]
        cases = cases_of(**part.axes, seed=range(part.first, part.first + part.more * given.runs))
        runs = kept_runs(partial(part.work, cache=cache), cases, given.out / "runs" / name, given).checked()
        tables[name] = part.table(runs)
    publish(given, "\n".join(f"{name}\n{table}" for name, table in tables.items()), tables)


if __name__ == "__main__":
    sys.exit(main())
