"""How near the filter comes to the best there can be, and what becomes of it in hard runs: parts of the study."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics import HIDDEN, OUTER, four_mass_phantom, pack
from estimators import ForceMode, TargetEstimate, TissueFilter, coverage, posterior_bound
from experiments.arrays import Floats
from experiments.engine.runs import Case
from experiments.studies.estimation.runs import Row, Study, figures
from experiments.studies.estimation.trials import (
    EXACTLY,
    KNOTS_PER_S,
    Model,
    Outcome,
    Trial,
    outcome_of,
    outcome_row,
    run,
    seen,
    truth,
)

TREMOR = 0.05
"""Of the shipped scenarios, white acceleration on each free node [m/s²/sqrt(Hz)]."""

FAR_M = 0.04
"""Error of the hidden mass that counts as large [m]."""

UNREPORTED_S = 0.5
"""Time [s] within which a filter of such an error must report it."""


def hard_trial(k: int) -> Trial:
    """One of the thousand: frame rate, noise and strength of the pokes at random, three marks in ten lost."""
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


def hard(study: Study) -> dict[str, Row]:
    """1,000 runs of 6 s over frame rates 5 to 120, 0.5 to 8 mm, 30 % of the marks lost, pokes up to 1.5 times."""
    cases = [{"seed": k} for k in range(10 * study.n_runs)]
    outcomes = [outcome_of(row) for row in study.rows("hard", hard_row, cases)]
    upright = [one for one in outcomes if not one.turned]
    rows = {"upright": figures(upright) | _far(upright)}
    if over := [one for one in outcomes if one.turned]:
        rows["turned over"] = figures(over) | _far(over)
    return rows


def hard_row(case: Case, cache: Path) -> dict[str, Any]:
    """One of the thousand."""
    return outcome_row(run(hard_trial(case["seed"]), Model(), cache))


def overturned(study: Study) -> dict[str, Row]:
    """Pokes so strong that the truth turns over: whether the filter follows, or reports that it does not."""
    rows: dict[str, Row] = {}
    strengths = (1.5, 2.0, 3.0)
    cases = [{"strength": strength, "seed": 3000 + seed} for strength in strengths for seed in study.seeds]
    found = study.rows("overturned", overturned_row, cases)
    for strength in strengths:
        outcomes = [outcome_of(row) for row in found if row["strength"] == strength]
        over = [one for one in outcomes if one.turned]
        if over:
            rows[f"{10 * strength:g} m/s²"] = figures(over) | _far(over)
    return rows


def overturned_row(case: Case, cache: Path) -> dict[str, Any]:
    """One run of strong pokes."""
    return outcome_row(run(Trial("shoved", case["seed"], strength=case["strength"]), Model(), cache))


def bound_row(case: Case, cache: Path) -> dict[str, Any]:
    """Squared error of the filter in a quiet run, and what the posterior Cramér-Rao bound leaves, each (n_frames,)."""
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
    filtered = run(trial, Model(), cache).filtered
    return {"squared": filtered**2, "bound": np.trace(covs, axis1=1, axis2=2)}


def bound(study: Study) -> dict[str, Row]:
    """Nobody pokes, constants known: RMSE by the posterior Cramér-Rao bound; 4.14 mm, 30 frames/s."""
    runs = study.rows("bound", bound_row, [{"seed": seed} for seed in study.seeds])
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


def _cases(scenarios: Sequence[str], study: Study) -> list[Case]:
    return [{"scenario": name, "seed": seed} for name in scenarios for seed in study.seeds]


def lost_row(case: Case, cache: Path) -> dict[str, Any]:
    """All marks lost from 3 to 5 s: statuses meanwhile, growth of sigma, and error and NEES half a second after."""
    scenario, seed = case["scenario"], case["seed"]
    network, trial = four_mass_phantom(), Trial(scenario, seed)
    frames, hidden = seen(trial, cache, np.random.default_rng([seed, 6]))
    tissue = TissueFilter(network, HIDDEN, OUTER, EXACTLY)
    estimates: list[TargetEstimate] = []
    for time_s, marks in frames[:166]:
        tissue.predict(time_s)
        estimates.append(tissue.update([] if 90 <= len(estimates) < 150 else marks))
    error = estimates[165].mean - hidden[165]
    before, late, after = (np.array(estimates[k].cov, dtype=float) for k in (89, 149, 165))
    return {
        "coasted_then_lost": [e.status.value for e in estimates[91:149]] == ["COASTING"] * 28 + ["LOST"] * 30
        or [e.status.value for e in estimates[91:149]] == ["COASTING"] * 29 + ["LOST"] * 29,
        "grew": bool(np.trace(late) > np.trace(before)),
        "tracking": estimates[165].status.value == "TRACKING",
        "nees": float(error @ np.linalg.solve(after, error)),
        "error_mm": 1e3 * float(np.linalg.norm(error)),
    }


def lost(study: Study) -> dict[str, Row]:
    """All marks lost for 2 s, pokes going on, and half a second of them after; 4.14 mm, 30 frames/s."""
    rows: dict[str, Row] = {}
    names = ("quiet", "poked", "shoved")
    found = study.rows("lost", lost_row, _cases(names, study))
    for name in names:
        runs = [row for row in found if row["scenario"] == name]
        rows[name] = {
            "runs": len(runs),
            "coasted_then_lost": sum(one["coasted_then_lost"] for one in runs),
            "grew": sum(one["grew"] for one in runs),
            "tracking": sum(one["tracking"] for one in runs),
            "coverage95": coverage([one["nees"] for one in runs], 2),
            "mean_mm": float(np.mean([one["error_mm"] for one in runs])),
            "worst_mm": float(np.max([one["error_mm"] for one in runs])),
        }
    return rows


def _far(outcomes: Sequence[Outcome]) -> Row:
    """Runs that diverged, and the longest time [s] for which one was surely wrong and TRACKING.

    Diverged: an error of more than FAR_M while TRACKING, for UNREPORTED_S or longer or in the last frame. Surely wrong:
    more than FAR_M with a NEES above 30, which one frame in three million has.
    """
    diverged, longest = 0, 0.0
    for one in outcomes:
        far = (one.filtered > FAR_M) & (np.array(one.status) == "TRACKING")
        diverged += bool(_longest(one.times_s, far) >= UNREPORTED_S or far[-1])
        longest = max(longest, _longest(one.times_s, far & (one.nees > 30.0)))
    ever = sum(bool((one.filtered > FAR_M).any()) for one in outcomes)
    return {"runs_diverged": diverged, "runs_ever_far": ever, "longest_unsaid_s": longest}


def _longest(times_s: Floats, wrong: NDArray[np.bool_]) -> float:
    """The longest time [s] from the first to the last frame of an unbroken row of these."""
    longest, since = 0.0, None
    for time_s, now in zip(times_s, wrong, strict=True):
        since = (time_s if since is None else since) if now else None
        longest = max(longest, 0.0 if since is None else float(time_s - since))
    return longest
