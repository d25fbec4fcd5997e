"""Seeded runs by the hundred: on several processes, their truths kept in a folder, their figures in rows."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from estimators import coverage
from experiments.studies.estimation.trials import Outcome

Row = dict[str, float | int | str]


@dataclass(frozen=True, slots=True)
class Study:
    """Where a study keeps its truths, how many runs each figure takes, and on how many processes."""

    folder: Path
    n_runs: int
    n_processes: int = 2

    @property
    def seeds(self) -> list[int]:
        """Of the runs."""
        return list(range(100, 100 + self.n_runs))

    @property
    def cache(self) -> Path:
        """Where truths are kept."""
        return self.folder / "truth"

    def all(self, work: Callable[..., Outcome | dict[str, object]], jobs: Sequence[tuple[object, ...]]) -> list[Any]:
        """The results of work(*job, cache) in the order of the jobs, counted on standard error as they come."""
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
