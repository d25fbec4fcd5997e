"""Accuracy and consistency of the filter in seeded runs on the phantom: the figures of docs/estimation-study.md.

    python -m experiments.studies.estimation.study --out study             # all parts: hours on two cores
    python -m experiments.studies.estimation.study hard --runs 10 --out study
    python -m experiments.studies.estimation.study --out study --page      # rewrite the tables of the page, too

Parts are stored as JSON in the folder, their runs in `runs` and truths in `truth` beside them; an interrupted study
continues where it stopped. Truth is by SciPy's RK45 with friction and tremor; pokes are half sines (`poked`: one mass
at a time; `shoved`: all outer masses at once, 10 m/s², the target swings by 70 to 140 mm). The true tissue is always
the phantom: errors of constants are in the model.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from dynamics import (
    HIDDEN,
    KINDS,
    OUTER,
    four_mass_phantom,
    independent_uncertainty,
    parameter_value,
    parameters,
    scale_parameters,
)
from estimators import FilterSettings, coverage, identify_constants
from experiments.engine.runs import Case
from experiments.engine.workers import ALL_CORES, Workers, chosen_workers
from experiments.formats.outputs import write_whole
from experiments.studies.estimation.limits import bound_row, hard_trial, longest
from experiments.studies.estimation.page import TABLES
from experiments.studies.estimation.trials import Frames, Model, Outcome, Trial, run, seen
from experiments.studies.grid import command, kept_runs, print_figures, publish, study_options
from experiments.studies.grid import grid as cases_of

CONSTANT_SDS = dict.fromkeys(KINDS, 0.1) | {"rest_length": 0.01}
"""Relative standard deviations of the errors of constants, by kind: 10 %, rest lengths 1 % (2 mm)."""

SCENARIOS = ("quiet", "poked", "shoved")
FAR_M = 0.04
"""Error of the hidden mass above which it counts as large [m]."""

UNREPORTED_S = 0.5
"""Time within which a filter must report such an error [s]."""

Row = dict[str, float | int]


@dataclass(frozen=True, slots=True)
class Study:
    """Folder of a study's runs and truths, number of runs for each figure, and workers."""

    folder: Path
    n_runs: int
    workers: Workers = ALL_CORES

    @property
    def seeds(self) -> range:
        """Seeds of the runs."""
        return range(100, 100 + self.n_runs)

    @property
    def cache(self) -> Path:
        """Folder of the truths."""
        return self.folder / "truth"

    def runs(self, part: str, work: Callable[..., Any], cases: Sequence[Case]) -> pd.DataFrame:
        """The rows that work(case, cache=...) returns for all cases, in order, stored in the folder `runs/PART`."""
        return kept_runs(partial(work, cache=self.cache), cases, self.folder / "runs" / part, self.workers)


def row_of(outcome: Outcome) -> dict[str, Any]:
    """The figures of one run: mean [mm], mean square [mm²] and largest error [mm], and shares of its frames.

    diverged: an error above FAR_M while TRACKING, for at least UNREPORTED_S or in the last frame; ever_far: such an
    error at any time; unsaid_s: the longest time with TRACKING, an error above FAR_M and a NEES above 30, which by
    chance occurs in one frame of three million
    """
    ours_mm = 1e3 * outcome.filtered
    far = (outcome.filtered > FAR_M) & (np.array(outcome.status) == "TRACKING")
    return {
        "frames": len(ours_mm),
        "open_loop_mm": float(1e3 * outcome.open_loop.mean()),
        "filter_mm": float(ours_mm.mean()),
        "square_mm2": float((ours_mm**2).mean()),
        "worst_mm": float(ours_mm.max()),
        "coverage95": coverage(outcome.nees, 2),
        "nees": float(outcome.nees.mean()),
        "diverged_frames": outcome.status.count("DIVERGED"),
        "repairs": outcome.repairs,
        "turned": outcome.turned,
        "diverged": bool(longest(outcome.times_s, far) >= UNREPORTED_S or far[-1]),
        "ever_far": bool((outcome.filtered > FAR_M).any()),
        "unsaid_s": longest(outcome.times_s, far & (outcome.nees > 30.0)),
    }


def figures(runs: pd.DataFrame) -> Row:
    """Mean errors [mm], their ratio, 95 % coverage, mean NEES, worst error [mm], frames by status and repairs."""

    def mean(column: str) -> float:
        return float(np.average(runs[column], weights=runs["frames"]))

    return {
        "runs": len(runs),
        "open_loop_mm": mean("open_loop_mm"),
        "filter_mm": mean("filter_mm"),
        "ratio": mean("filter_mm") / mean("open_loop_mm"),
        "coverage95": mean("coverage95"),
        "nees": mean("nees"),
        "rmse_mm": float(np.sqrt(mean("square_mm2"))),
        "worst_mm": float(runs["worst_mm"].max()),
        "frames": int(runs["frames"].sum()),
        "diverged_frames": int(runs["diverged_frames"].sum()),
        "repairs": int(runs["repairs"].sum()),
    }


def far_figures(runs: pd.DataFrame) -> Row:
    """Content of `figures`, numbers of runs that diverged or were ever far, and longest unreported error [s]."""
    far = {"runs_diverged": int(runs["diverged"].sum()), "runs_ever_far": int(runs["ever_far"].sum())}
    return figures(runs) | far | {"longest_unsaid_s": float(runs["unsaid_s"].max())}


def by_scenario(runs: pd.DataFrame, label: str = "") -> dict[str, Row]:
    """Figures of all frames together and of each scenario, whose label is `label` with its name."""
    each = {f"{label}{name}": figures(own) for name, own in runs.groupby("scenario", sort=False)}
    return {f"{label}all": figures(runs)} | each


def perturbed(seed: int, *, known: bool = False) -> Model:
    """The phantom with errors of its constants by `CONSTANT_SDS`; known: whether their uncertainty is considered."""
    network = four_mass_phantom()
    which = parameters(network)
    sds = np.array([CONSTANT_SDS[one.kind] for one in which])
    change = sds * np.random.default_rng([seed, 1]).normal(size=len(which))
    uncertainty = independent_uncertainty(which, sds) if known else None
    return Model(scale_parameters(network, which, change), uncertainty, FilterSettings())


def calibration(seed: int, cache: Path) -> Frames:
    """Calibration recording: 30 s of the poked phantom, all four marks with 4.14 mm of noise, 30 frames/s."""
    trial = Trial("poked", seed + 500, duration_s=30.0)
    return seen(trial, cache, np.random.default_rng([seed, 2]), (*OUTER, HIDDEN))[0]


def identified(study: Study) -> dict[str, Row]:
    """Both methods with wrong constants (10 %) after their identification from 30 s; noise of 4.14 mm, 30 frames/s."""
    found = study.runs("identified", identified_rows, cases_of(seed=study.seeds))
    means = found.drop_duplicates("seed")[["chi2_by_degrees", "passes", "directions"]].mean()
    return by_scenario(found) | {"constants": means.to_dict()}


def identified_rows(case: Case, cache: Path) -> list[dict[str, Any]]:
    """Rows of one phantom: its wrong constants are identified from a calibration, then all scenarios are tracked."""
    seed = case["seed"]
    model = perturbed(seed)
    found = identify_constants(model.network, calibration(seed, cache), OUTER, HIDDEN, prior_sd=CONSTANT_SDS)
    known = replace(model, network=found.network, uncertainty=found.uncertainty)
    network = four_mass_phantom()
    true = np.log([parameter_value(network, one) / parameter_value(model.network, one) for one in found.parameters])
    error = found.change - true
    own = {
        "chi2_by_degrees": float(error @ np.linalg.solve(found.cov, error)) / len(error),
        "passes": found.passes,
        "directions": len(found.uncertainty.directions),
    }
    return [{"scenario": name, **own, **row_of(run(Trial(name, seed), known, cache))} for name in SCENARIOS]


def unidentified(study: Study) -> dict[str, Row]:
    """The filter with constants wrong by 10 % and not identified; it considers or ignores their uncertainty."""
    cases = cases_of(uncertainty=("considered", "ignored"), scenario=SCENARIOS, seed=study.seeds)
    found = study.runs("unidentified", unidentified_row, cases).groupby("uncertainty", sort=False)
    return {name: row for label, runs in found for name, row in by_scenario(runs, f"{label}, ").items()}


def unidentified_row(case: Case, cache: Path) -> dict[str, Any]:
    """One run with wrong constants, whose uncertainty is considered or ignored."""
    model = perturbed(case["seed"], known=case["uncertainty"] == "considered")
    return row_of(run(Trial(case["scenario"], case["seed"]), model, cache))


def bound(study: Study) -> dict[str, Row]:
    """RMSE relative to the posterior Cramér-Rao bound; no pokes, exact constants, noise of 4.14 mm, 30 frames/s."""
    runs = study.runs("bound", bound_row, cases_of(seed=study.seeds))
    rows: dict[str, Row] = {}
    for label, own in runs.groupby("from", sort=False):
        rmse_mm, bound_mm = (1e3 * float(np.sqrt(own[key].mean())) for key in ("square_m2", "bound_m2"))
        rows[str(label)] = {"runs": len(own), "rmse_mm": rmse_mm, "bound_mm": bound_mm, "ratio": rmse_mm / bound_mm}
    return rows


def hard(study: Study) -> dict[str, Row]:
    """1,000 runs of 6 s: 5 to 120 frames/s, mark noise of 0.5 to 8 mm, 30 % of marks lost, pokes up to 1.5-fold."""
    runs = study.runs("hard", hard_row, cases_of(seed=range(10 * study.n_runs)))
    parts = {"upright": runs[~runs["turned"]], "turned over": runs[runs["turned"]]}
    return {label: far_figures(own) for label, own in parts.items() if len(own)}


def hard_row(case: Case, cache: Path) -> dict[str, Any]:
    """One of the thousand runs."""
    return row_of(run(hard_trial(case["seed"]), Model(), cache))


PARTS: dict[str, Callable[[Study], dict[str, Row]]] = {
    one.__name__: one for one in (identified, unidentified, bound, hard)
}


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Run the named parts, or all, and store their figures."""
    parser = study_options(__doc__, page="estimation-study.md")
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], help="parts of the study; default: all")
    parser.add_argument("--runs", type=int, default=100)
    chosen = parser.parse_args(arguments)
    study = Study(chosen.out, chosen.runs, chosen_workers(chosen))
    study.cache.mkdir(parents=True, exist_ok=True)
    tables = {}
    for name in chosen.parts or PARTS:
        rows = PARTS[name](study)
        tables[name] = TABLES[name](rows)
        write_whole(study.folder / f"{name}.json", json.dumps(rows, indent=1) + "\n")
        for label, row in rows.items():
            print_figures(f"{label}: ", row)
    publish(chosen, "", tables)


if __name__ == "__main__":
    sys.exit(main())
