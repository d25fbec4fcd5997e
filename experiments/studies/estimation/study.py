"""How accurate and consistent the filter is, in seeded runs on the phantom: the figures of docs/estimation-study.md.

    python -m experiments.studies.estimation.study --out study             # all parts: hours on two cores
    python -m experiments.studies.estimation.study grid --runs 10 --out study
    python -m experiments.studies.estimation.page study                    # rewrite the page from what is there

Parts are kept as JSON in the folder, their runs in `runs` and truths in `truth` beside them; a study that was ended
goes on where it stopped. Truth is by SciPy's RK45 with friction and tremor; pokes
are half sines (`poked`: one mass at a time; `shoved`: all outer masses at once, 10 m/s², the target swings by 70 to
140 mm). Errors of constants are in the model: what is true stays the phantom's.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache as once
from pathlib import Path
from typing import Any

import numpy as np

from dynamics import (
    HIDDEN,
    KINDS,
    OUTER,
    ParameterUncertainty,
    fit_rest_lengths,
    four_mass_phantom,
    independent_uncertainty,
    parameter_value,
    parameters,
    scale_parameters,
)
from estimators import FilterSettings, identify_constants, principal_uncertainty
from experiments.engine.runs import Case
from experiments.engine.workers import add_worker_options, chosen_workers
from experiments.formats.outputs import write_whole
from experiments.studies.estimation.limits import bound, hard, lost, overturned
from experiments.studies.estimation.runs import Row, Study, by_scenario
from experiments.studies.estimation.trials import Frames, Model, Outcome, Trial, outcome_of, outcome_row, run, seen

CONSTANT_SDS = dict.fromkeys(KINDS, 0.1) | {"rest_length": 0.01}
"""Relative standard deviations of the errors of constants, by kind: 10 %, rest lengths 1 % (2 mm)."""

LEFT = {kind: 0.02 for kind in KINDS if kind != "rest_length"}
"""What is taken to be left after identification in the grid; rest lengths are corrected by a picture at rest."""

SCENARIOS = ("quiet", "poked", "shoved")

NOISES_MM = (0.1, 0.3, 1.0, 4.14, 8.0)
RATES = (5, 10, 30, 60, 120)


def perturbed(seed: int, sds: dict[str, float], uncertainty: ParameterUncertainty | None = None) -> Model:
    """The phantom with random errors of its constants of these relative standard deviations."""
    network = four_mass_phantom()
    which = parameters(network, tuple(sds))
    change = np.random.default_rng([seed, 1]).normal(size=len(which)) * [sds[one.kind] for one in which]
    return Model(scale_parameters(network, which, change), uncertainty, FilterSettings())


def resting(model: Model) -> Model:
    """The model with rest lengths corrected by a picture of the true phantom at rest."""
    return replace(model, network=fit_rest_lengths(model.network, four_mass_phantom().positions))


def calibration(seed: int, cache: Path) -> Frames:
    """30 s of the poked phantom, all four marks seen with 4.14 mm of noise, 30 frames/s."""
    trial = Trial("poked", seed + 500, duration_s=30.0)
    return seen(trial, cache, np.random.default_rng([seed, 2]), (*OUTER, HIDDEN))[0]


def identified_run(seed: int, cache: Path) -> dict[str, Any]:
    """One phantom with wrong constants, identified from a calibration recording, then tracked in all scenarios."""
    model = perturbed(seed, CONSTANT_SDS)
    found = identify_constants(model.network, calibration(seed, cache), OUTER, HIDDEN, prior_sd=CONSTANT_SDS)
    known = replace(model, network=found.network, uncertainty=found.uncertainty)
    network = four_mass_phantom()
    true = np.log([parameter_value(network, one) / parameter_value(model.network, one) for one in found.parameters])
    error = found.change - true
    return {
        "outcomes": {name: run(Trial(name, seed), known, cache) for name in SCENARIOS},
        "chi2": float(error @ np.linalg.solve(found.cov, error)),
        "passes": found.passes,
        "directions": len(found.uncertainty.directions),
    }


def identified(study: Study) -> dict[str, Row]:
    """Constants wrong by 10 %, identified from 30 s, both methods with what was found; 4.14 mm, 30 frames/s."""
    found = study.rows("identified", identified_rows, [{"seed": seed} for seed in study.seeds])
    rows = by_scenario({name: [outcome_of(row) for row in found if row["scenario"] == name] for name in SCENARIOS})
    runs = found[:: len(SCENARIOS)]
    rows["constants"] = {
        "chi2_by_degrees": float(np.mean([one["chi2"] for one in runs]) / len(parameters(four_mass_phantom()))),
        "passes": float(np.mean([one["passes"] for one in runs])),
        "directions": float(np.mean([one["directions"] for one in runs])),
    }
    return rows


def identified_rows(case: Case, cache: Path) -> list[dict[str, Any]]:
    """`identified_run`, a row for each scenario."""
    found = identified_run(case["seed"], cache)
    own = {name: value for name, value in found.items() if name != "outcomes"}
    return [{"scenario": name, **own, **outcome_row(one)} for name, one in found["outcomes"].items()]


def unidentified(study: Study) -> dict[str, Row]:
    """Constants wrong by 10 %, not identified: the filter considers their uncertainty, or ignores it."""
    labels = ("considered", "ignored")
    cases = [
        {"uncertainty": label, "scenario": name, "seed": seed}
        for label in labels
        for name in SCENARIOS
        for seed in study.seeds
    ]
    found = study.rows("unidentified", unidentified_row, cases)
    return _labelled({label: [row for row in found if row["uncertainty"] == label] for label in labels})


def unidentified_row(case: Case, cache: Path) -> dict[str, Any]:
    """One run with wrong constants, their uncertainty considered or ignored."""
    which = parameters(four_mass_phantom())
    known = independent_uncertainty(which, [CONSTANT_SDS[one.kind] for one in which])
    model = perturbed(case["seed"], CONSTANT_SDS, known if case["uncertainty"] == "considered" else None)
    return outcome_row(run(Trial(case["scenario"], case["seed"]), model, cache))


def _labelled(rows_of: dict[str, list[dict[str, Any]]]) -> dict[str, Row]:
    """`by_scenario` of the outcomes under each label, as `label, scenario`."""
    rows: dict[str, Row] = {}
    for label, found in rows_of.items():
        outcomes: dict[str, list[Outcome]] = {}
        for row in found:
            outcomes.setdefault(row["scenario"], []).append(outcome_of(row))
        rows |= {f"{label}, {name}": row for name, row in by_scenario(outcomes).items()}
    return rows


def grid(study: Study) -> dict[str, Row]:
    """Mark noise by frame rate, constants wrong by 2 %, known to that, rest seen; half the runs quiet, half shoved."""
    cases = [
        {"noise_mm": noise, "rate": rate, "scenario": name, "seed": seed}
        for noise in NOISES_MM
        for rate in RATES
        for name in ("quiet", "shoved")
        for seed in study.seeds[: (study.n_runs + 1) // 2]
    ]
    found: dict[str, list[dict[str, Any]]] = {}
    for row in study.rows("grid", grid_row, cases):
        found.setdefault(f"{row['noise_mm']:g} mm, {row['rate']}/s", []).append(row)
    return _labelled(found)


def grid_row(case: Case, cache: Path) -> dict[str, Any]:
    """One run of the grid."""
    noise_m, seed = 1e-3 * case["noise_mm"], case["seed"]
    trial = Trial(case["scenario"], seed, frames_per_s=case["rate"], mark_sd_m=noise_m)
    return outcome_row(run(trial, resting(perturbed(seed, LEFT, _left(cache))), cache))


@once
def _left(cache: Path) -> ParameterUncertainty:
    """The uncertainty that identification leaves in the grid, in few directions."""
    network = four_mass_phantom()
    which = parameters(network, tuple(LEFT))
    wide = independent_uncertainty(which, [LEFT[one.kind] for one in which])
    return principal_uncertainty(network, wide, calibration(0, cache), OUTER, HIDDEN)


PARTS: dict[str, Callable[[Study], dict[str, Row]]] = {
    "identified": identified,
    "grid": grid,
    "unidentified": unidentified,
    "bound": bound,
    "hard": hard,
    "overturned": overturned,
    "lost": lost,
}


def main() -> None:
    """Run the parts named, or all, and keep their figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], help="default: all")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=100)
    add_worker_options(parser)
    chosen = parser.parse_args()
    study = Study(chosen.out, chosen.runs, chosen_workers(chosen))
    study.cache.mkdir(parents=True, exist_ok=True)
    for name in chosen.parts or PARTS:
        sys.stderr.write(f"{name}\n")
        rows = PARTS[name](study)
        write_whole(study.folder / f"{name}.json", json.dumps(rows, indent=1) + "\n")
        for label, row in rows.items():
            columns = "  ".join(f"{key} {value:.3g}" for key, value in row.items() if not isinstance(value, str))
            sys.stdout.write(f"{label}: {columns}\n")


if __name__ == "__main__":
    main()
