"""Seeded runs by the hundred, kept as they finish with their truths beside them, and their figures in rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from estimators import coverage
from experiments.engine.progress import run_bar
from experiments.engine.runs import Case
from experiments.engine.study import run_study
from experiments.engine.workers import ALL_CORES, Workers
from experiments.studies.estimation.trials import Outcome

Row = dict[str, float | int | str]


@dataclass(frozen=True, slots=True)
class Study:
    """Where a study keeps its runs and truths, how many runs each figure takes, and where they are done."""

    folder: Path
    n_runs: int
    workers: Workers = ALL_CORES

    @property
    def seeds(self) -> list[int]:
        """Of the runs."""
        return list(range(100, 100 + self.n_runs))

    @property
    def cache(self) -> Path:
        """Where truths are kept."""
        return self.folder / "truth"

    def rows(self, part: str, work: Callable[..., Any], cases: Sequence[Case]) -> list[dict[str, Any]]:
        """The rows of work(case, cache=...) of all cases, in their order, kept in the folder `runs/PART`."""
        kept = self.folder / "runs" / part
        with run_bar(part) as advance:
            table = run_study(partial(work, cache=self.cache), cases, kept, self.workers, advance).checked()
        return [{str(name): value for name, value in row.items()} for row in table.to_dict("records")]


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
