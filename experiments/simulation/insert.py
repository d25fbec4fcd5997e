"""Comparison of insertion policies in simulated robotic insertions: `softaim insert SCENARIO --out DIR`.

For each seed all policies face the same true motion. `docs/insertion.md` has the results.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from estimators import ReliabilityBin, clopper_pearson, reliability_bins
from experiments.engine.executor import results
from experiments.engine.workers import OWN_PROCESS, Workers
from experiments.formats.outputs import write_whole
from experiments.simulation.advised import AdvisedInsertion, advice_figures, advised
from experiments.simulation.cases import Case
from experiments.simulation.closed_loop import Tried, attempt
from experiments.simulation.policies import POLICIES, Ahead, Filtered, Rest, Waiting, warmed
from experiments.simulation.world import world_of


@dataclass(frozen=True, slots=True)
class Trials:
    """Results of all runs.

    runs: for each run, the result of each policy
    advised: for each run, the results of insertions that follow advice
    """

    case: Case
    runs: tuple[tuple[Tried, ...], ...]
    advised: tuple[tuple[AdvisedInsertion, ...], ...]

    def of(self, policy: str) -> list[Tried]:
        """The results of one policy in all runs."""
        return [one for run in self.runs for one in run if one.policy == policy]


def insert(
    case: Case, n_runs: int, advance: Callable[[float], None] = lambda _share: None, *, workers: Workers = OWN_PROCESS
) -> Trials:
    """Try every policy in n_runs worlds with successive seeds. Raises InputError for an impossible scenario."""
    jobs = [replace(case, seed=case.seed + k) for k in range(n_runs)]
    done = results(one_run, jobs, workers, advance)
    return Trials(case, tuple(tried for tried, _ in done), tuple(of_run for _, of_run in done))


def one_run(case: Case) -> tuple[tuple[Tried, ...], tuple[AdvisedInsertion, ...]]:
    """Results of every policy in the world of a case, and results of insertions that follow advice."""
    world = world_of(case)
    state, paper, warm = warmed(world)
    tried = [attempt(world, policy, state) for policy in (Rest(world), paper)]
    # in sequence, because all share one filter, which is restored each time
    tried += [attempt(world, policy(world, warm), state) for policy in (Filtered, Ahead, Waiting)]
    return tuple(tried), advised(world, warm, state) if case.advice else ()


def calibrated(done: Trials) -> tuple[ReliabilityBin, ...]:
    """Reliability of the hit probabilities of policy `filter-ahead`, for lesions with a random radius."""
    committed = [one for one in done.of("filter-ahead") if one.drawn_probability is not None]
    predicted = [one.drawn_probability for one in committed if one.drawn_probability is not None]
    return reliability_bins(predicted, [bool(one.drawn_hit) for one in committed])


def summary(done: Trials) -> dict[str, object]:
    """Content of summary.json."""
    case = done.case
    return {
        "scenario": case.scenario.title,
        "runs": len(done.runs),
        "radius_mm": 1e3 * case.plan.lesion.radius_m,
        "speed_mm_s": 1e3 * case.plan.insertion.speed_m_s,
        "steer_mm_s": 1e3 * case.steer_m_s,
        "strength": case.strength,
        **{policy: figures(done.of(policy)) for policy in POLICIES},
        "advise": advice_figures(done.advised),
        "calibration": [asdict(row) for row in calibrated(done)],
    }


def figures(tried: Sequence[Tried]) -> dict[str, float | int | None]:
    """Figures of one policy over all runs.

    hit_rate, hit_rate_low, hit_rate_high: share of hits, and the ends of the 95 % interval of this share [clopper1934]
    miss_mm: mean miss of the needles that arrived; seconds_to_hit: mean time until a hit
    insertions, retractions: mean numbers per run; never: number of runs without arrival
    predicted, observed: mean predicted hit probability, and hit rate of the same insertions
    """
    n, hits = len(tried), sum(one.hit for one in tried)
    low, high = clopper_pearson(hits, n, 0.95)
    missed = np.array([1e3 * one.miss_m for one in tried if one.miss_m is not None])
    stated = [one.probability for one in tried if one.probability is not None]
    came = [one.hit for one in tried if one.probability is not None]
    took = [one.seconds for one in tried if one.hit]
    return {
        "hit_rate": hits / n,
        "hit_rate_low": low,
        "hit_rate_high": high,
        "miss_mm": float(missed.mean()) if len(missed) else None,
        "miss_median_mm": float(np.median(missed)) if len(missed) else None,
        "miss_95_mm": float(np.quantile(missed, 0.95)) if len(missed) else None,
        "seconds_to_hit": float(np.mean(took)) if took else None,
        "insertions": float(np.mean([one.insertions for one in tried])),
        "retractions": float(np.mean([one.insertions - (one.miss_m is not None) for one in tried])),
        "never": sum(one.miss_m is None for one in tried),
        "predicted": float(np.mean(stated)) if stated else None,
        "observed": float(np.mean(came)) if came else None,
    }


def table(done: Trials) -> pd.DataFrame:
    """Content of runs.csv: a row for each run and policy; missing values are empty."""
    rows = [
        {
            "seed": done.case.seed + k,
            "policy": one.policy,
            "hit": int(one.hit),
            "miss_mm": None if one.miss_m is None else 1e3 * one.miss_m,
            "seconds": one.seconds,
            "insertions": one.insertions,
            "p_hit": one.probability,
            "predicted_radius_mm": 1e3 * one.drawn_radius_m,
            "predicted": one.drawn_probability,
        }
        for k, run in enumerate(done.runs)
        for one in run
    ]
    return pd.DataFrame(rows)


def advised_table(done: Trials) -> pd.DataFrame:
    """Content of advised.csv: a row for each advice; hit and miss_mm are empty if no needle was inserted."""
    rows = [
        {
            "seed": done.case.seed + k,
            "time_s": one.time_s,
            "advice": str(one.advice),
            "predicted": one.probability,
            "hit": None if one.hit is None else float(one.hit),
            "miss_mm": None if one.miss_m is None else 1e3 * one.miss_m,
        }
        for k, run in enumerate(done.advised)
        for one in run
    ]
    return pd.DataFrame(rows, columns=["seed", "time_s", "advice", "predicted", "hit", "miss_mm"])


def write_insertions(done: Trials, folder: Path) -> None:
    """Write summary.json, runs.csv and advised.csv to an existing folder."""
    write_whole(folder / "summary.json", json.dumps(summary(done), indent=2) + "\n")
    table(done).to_csv(folder / "runs.csv", index=False, float_format="%.6g")
    advised_table(done).to_csv(folder / "advised.csv", index=False, float_format="%.6g")
