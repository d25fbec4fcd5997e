"""What each choice of the filter is worth, in seeded runs on the phantom: the figures of docs/estimation-study.md.

    python -m experiments.estimation_study --out study             # all parts: hours on two cores
    python -m experiments.estimation_study grid --runs 10 --out study
    python -m experiments.estimation_study --out study --write     # rewrite the page's tables from what is there

Parts are kept as JSON in the folder, truths in `truth` beside them. Truth is DOP853's with friction and tremor; pokes
are half sines (`poked`: one mass at a time; `shoved`: all outer masses at once, 10 m/s², the target swings by 70 to
140 mm). Constants that are off are off in the model: what is true stays the phantom's.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics import (
    HIDDEN,
    KINDS,
    OUTER,
    Uncertainty,
    at_rest_where_seen,
    four_mass_phantom,
    independent,
    pack,
    parameters,
    scaled,
    value,
)
from estimators import (
    FilterSettings,
    ForceMode,
    ParticleFilter,
    TissueFilter,
    coverage,
    identify,
    posterior_bound,
    principal,
)
from experiments.trials import KNOTS_PER_S, Frames, Model, Outcome, Trial, run, seen, truth

Floats = NDArray[np.float64]
Row = dict[str, float | int | str]

OFF = dict(zip(KINDS, (0.1, 0.01, 0.1, 0.1, 0.1), strict=True))
"""Relative standard deviations of the constants that are off, by kind: 10 %, rest lengths 1 % (2 mm)."""

LEFT = {kind: 0.02 for kind in KINDS if kind != "rest_length"}
"""What is taken to be left after identification in the grid; rest lengths are corrected by a picture at rest."""

NOISES_MM = (0.1, 0.3, 1.0, 4.14, 8.0)
RATES = (5, 10, 30, 60, 120)
TREMOR = 0.05
"""Of the shipped scenarios, white acceleration on each free node [m/s²/sqrt(Hz)]."""

MANY = 30
"""Histories that the particle filter keeps."""

FAR_M = 0.04
"""Error of the hidden mass beyond which a run counts as diverged."""


@dataclass(frozen=True, slots=True)
class Study:
    """Where a study keeps its truths, how many runs each figure takes, and on how many processes."""

    folder: Path
    n_runs: int
    n_processes: int = 2

    @property
    def cache(self) -> Path:
        """Where truths are kept."""
        return self.folder / "truth"

    def all(self, work: Callable[..., Outcome | dict[str, object]], jobs: Sequence[tuple[object, ...]]) -> list[Any]:
        """The results of work(*job, cache) in the order of the jobs, told on standard error as they come."""
        results = []
        with ProcessPoolExecutor(self.n_processes) as pool:
            for k, result in enumerate(pool.map(partial(_call, work, self.cache), jobs, chunksize=1)):
                results.append(result)
                sys.stderr.write(f"\r{k + 1} of {len(jobs)} runs ")
        sys.stderr.write("\n")
        return results


def _call(work: Callable[..., object], cache: Path, job: tuple[object, ...]) -> object:
    return work(*job, cache)


def figures(outcomes: Iterable[Outcome]) -> Row:
    """Mean errors [mm], their ratio, 95 % coverage, mean NEES, worst error [mm], frames by status and repairs."""
    runs = list(outcomes)
    paper = 1e3 * np.concatenate([one.open_loop for one in runs])
    ours = 1e3 * np.concatenate([one.filtered for one in runs])
    nees = np.concatenate([one.nees for one in runs])
    counts = Counter(status for one in runs for status in one.status)
    return {
        "runs": len(runs),
        "open_loop_mm": float(paper.mean()),
        "filter_mm": float(ours.mean()),
        "ratio": float(ours.mean() / paper.mean()),
        "coverage95": coverage(nees, 2),
        "nees": float(nees.mean()),
        "rmse_mm": float(np.sqrt((ours**2).mean())),
        "worst_mm": float(ours.max()),
        "frames": len(ours),
        "diverged_frames": counts["DIVERGED"],
        "repairs": sum(sum(one.repairs.values()) for one in runs),
    }


def by_scenario(outcomes: dict[str, list[Outcome]]) -> dict[str, Row]:
    """`figures` of each scenario and of all frames together."""
    rows = {name: figures(runs) for name, runs in outcomes.items()}
    return {"all": figures([one for runs in outcomes.values() for one in runs])} | rows


def perturbed(seed: int, sds: dict[str, float], uncertainty: Uncertainty | None = None) -> Model:
    """The phantom with constants off at random by these relative standard deviations."""
    network = four_mass_phantom()
    which = parameters(network, tuple(sds))
    change = np.random.default_rng([seed, 1]).normal(size=len(which)) * [sds[one.kind] for one in which]
    return Model(scaled(network, which, change), uncertainty)


def resting(model: Model) -> Model:
    """The model with rest lengths corrected by a picture of the true phantom at rest."""
    return replace(model, network=at_rest_where_seen(model.network, four_mass_phantom().positions))


def calibration(seed: int, cache: Path) -> Frames:
    """30 s of the poked phantom, all four marks seen with 4.14 mm of noise, 30 frames/s."""
    trial = Trial("poked", seed + 500, duration_s=30.0)
    return seen(trial, cache, np.random.default_rng([seed, 2]), (*OUTER, HIDDEN))[0]


def identified_run(seed: int, cache: Path) -> dict[str, object]:
    """One phantom whose constants are off, identified from a calibration recording, then tracked in all scenarios."""
    model = perturbed(seed, OFF)
    found = identify(model.network, calibration(seed, cache), OUTER, HIDDEN, prior_sd=OFF)
    known = Model(found.network, found.uncertainty)
    network = four_mass_phantom()
    true = np.log([value(network, one) / value(model.network, one) for one in found.parameters])
    error = found.change - true
    return {
        "outcomes": {name: run(Trial(name, seed), known, cache) for name in ("quiet", "poked", "shoved")},
        "chi2": float(error @ np.linalg.solve(found.cov, error)),
        "passes": found.passes,
        "directions": len(found.uncertainty.directions),
    }


def identified(study: Study) -> dict[str, Row]:
    """10 % off, identified from 30 s, both methods with what was found; 4.14 mm, 30 frames/s."""
    runs = study.all(identified_run, [(seed,) for seed in _seeds(study)])
    rows = by_scenario({name: [one["outcomes"][name] for one in runs] for name in ("quiet", "poked", "shoved")})
    rows["constants"] = {
        "chi2_by_degrees": float(np.mean([one["chi2"] for one in runs]) / len(parameters(four_mass_phantom()))),
        "passes": float(np.mean([one["passes"] for one in runs])),
        "directions": float(np.mean([one["directions"] for one in runs])),
    }
    return rows


def unidentified(study: Study) -> dict[str, Row]:
    """10 % off and not identified: the covariance is told so, and not told."""
    network = four_mass_phantom()
    which = parameters(network)
    known = independent(which, [OFF[one.kind] for one in which])
    rows: dict[str, Row] = {}
    for label, uncertainty in (("told", known), ("not told", None)):
        outcomes = {
            name: study.all(run, [(Trial(name, seed), perturbed(seed, OFF, uncertainty)) for seed in _seeds(study)])
            for name in ("quiet", "poked", "shoved")
        }
        rows |= {f"{label}, {name}": row for name, row in by_scenario(outcomes).items()}
    return rows


def grid(study: Study) -> dict[str, Row]:
    """Mark noise by frame rate, constants 2 % off and known to so much, rest seen; half the runs quiet, half shoved."""
    network = four_mass_phantom()
    which = parameters(network, tuple(LEFT))
    wide = independent(which, [LEFT[one.kind] for one in which])
    few = principal(network, wide, calibration(0, study.cache), OUTER, HIDDEN)
    rows: dict[str, Row] = {}
    for noise in NOISES_MM:
        for rate in RATES:
            outcomes = {
                name: study.all(
                    run,
                    [
                        (
                            Trial(name, seed, frames_per_s=rate, mark_sd_m=1e-3 * noise),
                            resting(perturbed(seed, LEFT, few)),
                        )
                        for seed in _seeds(study)[: (study.n_runs + 1) // 2]
                    ],
                )
                for name in ("quiet", "shoved")
            }
            rows |= {f"{noise:g} mm, {rate}/s, {name}": row for name, row in by_scenario(outcomes).items()}
    return rows


def choices(study: Study) -> dict[str, Row]:
    """What each choice is worth: the filter with one thing changed; true constants, 4.14 mm, 30 frames/s."""
    usual = FilterSettings()
    strong = ForceMode(white=5.0, poke=0.05, lasting_s=0.05)
    never = {"calm_s": 1e9, "between_s": 1e9, "calm_share": 1.0}
    variants = {
        "as it is": usual,
        "one filter, white force of 5 m/s²/√Hz": replace(usual, quiet=strong, poked=strong),
        "one filter, poke as a state": replace(usual, quiet=usual.poked),
        "one filter, nobody pokes": replace(usual, **never),  # type: ignore[arg-type]
        "quiet and white force of 5 m/s²/√Hz": replace(usual, poked=strong),
        "two modes: a poke may come at any time": replace(usual, calm_s=usual.between_s),
        "poke of 3 m/s²": replace(usual, poked=replace(usual.poked, poke=3.0)),
        "poke of 10 m/s²": replace(usual, poked=replace(usual.poked, poke=10.0)),
        "white noise of 0.03 m/s²/√Hz": _white(usual, 0.03),
        "white noise of 0.06 m/s²/√Hz": _white(usual, 0.06),
    }
    rows: dict[str, Row] = {}
    for label, settings in variants.items():
        outcomes = {
            name: study.all(run, [(Trial(name, seed), Model(settings=settings)) for seed in _seeds(study)])
            for name in ("quiet", "poked", "shoved")
        }
        rows |= {f"{label}, {name}": row for name, row in by_scenario(outcomes).items()}
    return rows


def _white(settings: FilterSettings, white: float) -> FilterSettings:
    return replace(settings, quiet=replace(settings.quiet, white=white), poked=replace(settings.poked, white=white))


def hard_trial(k: int) -> Trial:
    """One of the thousand: frame rate, noise and strength of the pokes at random, three marks in ten lost."""
    rng = np.random.default_rng([k, 3])
    return Trial(
        "poked" if k % 2 else "shoved",
        5000 + k,
        duration_s=10.0,
        frames_per_s=int(rng.choice([5, 10, 15, 30, 60, 120])),
        mark_sd_m=float(np.exp(rng.uniform(np.log(0.0005), np.log(0.008)))),
        strength=float(rng.choice([1.0, 1.25, 1.5])),
        lost=0.3,
    )


def hard(study: Study) -> dict[str, Row]:
    """1,000 runs of 10 s over frame rates 5 to 120, 0.5 to 8 mm, 30 % of the marks lost, pokes up to 1.5 times."""
    outcomes = study.all(run, [(hard_trial(k), Model()) for k in range(10 * study.n_runs)])
    upright = [one for one in outcomes if not one.turned]
    rows = {"upright": figures(upright) | _far(upright)}
    if over := [one for one in outcomes if one.turned]:
        rows["turned over"] = figures(over) | _far(over)
    return rows


def overturned(study: Study) -> dict[str, Row]:
    """Pokes so strong that the truth turns over: whether the filter follows, or says so."""
    rows: dict[str, Row] = {}
    for strength in (1.5, 2.0, 3.0):
        outcomes = study.all(
            run, [(Trial("shoved", 3000 + seed, strength=strength), Model()) for seed in _seeds(study)]
        )
        over = [one for one in outcomes if one.turned]
        if over:
            rows[f"{10 * strength:g} m/s²"] = figures(over) | _far(over)
    return rows


def bound_run(seed: int, cache: Path) -> dict[str, Any]:
    """Squared error of the filter in a quiet run, and what the posterior Cramér-Rao bound leaves, each (n_frames,)."""
    network, trial = four_mass_phantom(), Trial("quiet", seed)
    positions = truth(trial, cache)
    dt, every = 1.0 / KNOTS_PER_S, KNOTS_PER_S // trial.frames_per_s
    states = pack(positions, np.gradient(positions, dt, axis=0))
    mark = trial.mark_sd_m**2 * np.eye(2)
    seen_marks = [dict.fromkeys(OUTER, mark) if k % every == 0 else {} for k in range(len(states))]
    start = TissueFilter(network, HIDDEN, OUTER).mixture.P[: network.n_state, : network.n_state]
    tremor = ForceMode(white=TREMOR, poke=1e-9, lasting_s=1.0)
    times = dt * np.arange(len(states))
    place = network.coordinates(HIDDEN)
    covs = posterior_bound(network, states, times, seen_marks, tremor, start)[::every, place, place]
    filtered = run(trial, Model(), cache).filtered
    return {"squared": filtered**2, "bound": np.trace(covs, axis1=1, axis2=2)}


def bound(study: Study) -> dict[str, Row]:
    """Nobody pokes, constants known: RMSE by the posterior Cramér-Rao bound; 4.14 mm, 30 frames/s."""
    runs = study.all(bound_run, [(seed,) for seed in _seeds(study)])
    rows: dict[str, Row] = {}
    for label, first in (("from the first frame", 0), ("after 2 s", 60)):
        squared, least = (float(np.mean([one[key][first:] for one in runs])) for key in ("squared", "bound"))
        rows[label] = {
            "runs": len(runs),
            "rmse_mm": 1e3 * float(np.sqrt(squared)),
            "bound_mm": 1e3 * float(np.sqrt(least)),
            "ratio": float(np.sqrt(squared / least)),
        }
    return rows


def optimum_run(scenario: str, seed: int, cache: Path) -> dict[str, Any]:
    """Squared errors of the filter and of a particle filter of mode histories on the same marks, each (n_frames,)."""
    network, trial = four_mass_phantom(), Trial(scenario, seed, duration_s=10.0)
    frames, hidden = seen(trial, cache, np.random.default_rng([seed, 4]))
    tissue = TissueFilter(network, HIDDEN, OUTER)
    particles = ParticleFilter(network, HIDDEN, OUTER, rng=np.random.default_rng([seed, 5]), n_particles=MANY)
    squared: dict[str, list[float]] = {"filter": [], "particles": []}
    for (time_s, marks), place in zip(frames, hidden, strict=True):
        for name, method in (("filter", tissue), ("particles", particles)):
            method.predict(time_s)
            off = method.update(marks).mean - place
            squared[name].append(float(off @ off))
    return {name: np.array(values) for name, values in squared.items()}


def optimum(study: Study) -> dict[str, Row]:
    """Poked, constants known: RMSE by that of a particle filter of mode histories; 10 s at 4.14 mm, 30 frames/s."""
    rows: dict[str, Row] = {}
    for name in ("poked", "shoved"):
        runs = study.all(optimum_run, [(name, seed) for seed in _seeds(study)])
        ours, best = (float(np.mean([one[key] for one in runs])) for key in ("filter", "particles"))
        rows[name] = {
            "runs": len(runs),
            "rmse_mm": 1e3 * float(np.sqrt(ours)),
            "particles_mm": 1e3 * float(np.sqrt(best)),
            "ratio": float(np.sqrt(ours / best)),
        }
    return rows


def _far(outcomes: Sequence[Outcome]) -> Row:
    """Runs that were ever far off while TRACKING, and the longest time [s] for which one was surely wrong unsaid.

    Surely wrong: a NEES above 30, which one frame in three million has, and more than FAR_M off.
    """
    far = [bool(((one.filtered > FAR_M) & (np.array(one.status) == "TRACKING")).any()) for one in outcomes]
    longest = 0.0
    for one in outcomes:
        wrong = (one.filtered > FAR_M) & (one.nees > 30.0) & (np.array(one.status) == "TRACKING")
        since = None
        for time_s, now in zip(one.times_s, wrong, strict=True):
            since = (time_s if since is None else since) if now else None
            longest = max(longest, 0.0 if since is None else float(time_s - since))
    return {"runs_far_off": sum(far), "longest_unsaid_s": longest}


def _seeds(study: Study) -> list[int]:
    return list(range(100, 100 + study.n_runs))


PARTS: dict[str, Callable[[Study], dict[str, Row]]] = {
    "identified": identified,
    "grid": grid,
    "unidentified": unidentified,
    "choices": choices,
    "bound": bound,
    "optimum": optimum,
    "hard": hard,
    "overturned": overturned,
}


def main() -> None:
    """Run the parts named, or all, and keep what they say."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], help="default: all")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=100)
    chosen = parser.parse_args()
    study = Study(chosen.out, chosen.runs)
    study.cache.mkdir(parents=True, exist_ok=True)
    for name in chosen.parts or PARTS:
        sys.stderr.write(f"{name}\n")
        rows = PARTS[name](study)
        (study.folder / f"{name}.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        for label, row in rows.items():
            told = "  ".join(f"{key} {value:.3g}" for key, value in row.items() if not isinstance(value, str))
            sys.stdout.write(f"{label}: {told}\n")


if __name__ == "__main__":
    main()
