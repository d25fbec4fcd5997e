"""What the engine costs beyond the runs, and how busy it keeps the cores.

    python -m experiments.studies.load                          # 2,000 runs of 50 ms of processor time each
    python -m experiments.studies.load --sweep STUDY.toml       # those of a sweep

prints runs, processes, wall time and, of the time of all processes, the share in which they did runs; and what a run
costs beyond itself, in wall time of a process (start and end of the cluster included) and in processor time of all
processes together. On a machine that does other work, too, the latter is what to go by. Figures: docs/sweep.md.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from experiments.engine.progress import run_bar
from experiments.engine.runs import Case, Work
from experiments.engine.study import run_study
from experiments.engine.workers import Workers, add_worker_options, chosen_workers


@dataclass(frozen=True, slots=True)
class Load:
    """What so many runs took on so many processes [s].

    wall_s: from the call to the table; runs_s, runs_cpu_s: of the runs alone, wall and processor time, summed
    cpu_s: processor time of all processes
    """

    n_runs: int
    n_processes: int
    wall_s: float
    runs_s: float
    runs_cpu_s: float
    cpu_s: float

    @property
    def figures(self) -> dict[str, float]:
        """As they are printed."""
        return {
            "runs": self.n_runs,
            "processes": self.n_processes,
            "wall_s": self.wall_s,
            "busy": self.runs_s / (self.n_processes * self.wall_s),
            "beyond_a_run_ms": 1e3 * (self.n_processes * self.wall_s - self.runs_s) / self.n_runs,
            "beyond_a_run_cpu_ms": 1e3 * (self.cpu_s - self.runs_cpu_s) / self.n_runs,
        }


def busy(case: Case) -> dict[str, float]:
    """A run that takes so much processor time [ms]."""
    until = time.process_time() + 1e-3 * case["ms"]
    while time.process_time() < until:
        pass
    return {"cpu_s": 1e-3 * case["ms"]}


def timed(case: Case, work: Work) -> list[dict[str, object]]:
    """The rows of a run, with its processor time."""
    began = time.process_time()
    rows = work(case)
    return [{**row, "cpu_s": time.process_time() - began} for row in rows]


def measured(work: Work, cases: list[Case], workers: Workers) -> Load:
    """What these runs take; work gives `cpu_s`, the processor time of a run."""
    cpu_s: list[float] = []

    def advance(share: float) -> None:
        bar(share)
        if share in (0.0, 1.0):  # the workers are still there
            cpu_s.append(_cpu_s())

    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder, run_bar("load") as bar:
        table = run_study(work, cases, Path(folder), workers, advance).checked().drop_duplicates("key")
    wall_s = time.perf_counter() - began
    sums = table[["seconds", "cpu_s"]].sum()
    n_processes, runs_s, runs_cpu_s = workers.n_local, float(sums["seconds"]), float(sums["cpu_s"])
    return Load(len(cases), n_processes, wall_s, runs_s, runs_cpu_s, cpu_s[-1] - cpu_s[0])


def _cpu_s() -> float:
    """Processor time of this process and of all below it that are there [s]."""
    import psutil

    own = psutil.Process()
    used = [process.cpu_times() for process in (own, *own.children(recursive=True))]
    return sum(one.user + one.system for one in used)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--ms", type=float, default=50.0, help="processor time of a run")
    parser.add_argument("--sweep", type=Path, help="runs of this sweep file in place of synthetic ones")
    add_worker_options(parser)
    chosen = parser.parse_args()
    if chosen.sweep is None:
        cases: list[Case] = [{"seed": seed, "ms": chosen.ms} for seed in range(chosen.runs)]
        load = measured(busy, cases, chosen_workers(chosen))
    else:
        # here, so that synthetic runs do not wait for the filters to load
        from experiments.formats.sweep_file import read_sweep
        from experiments.pipeline.sweep import cases_of, swept_rows

        with tempfile.TemporaryDirectory() as truths:
            work = partial(timed, work=partial(swept_rows, truths=Path(truths)))
            load = measured(work, list(cases_of(read_sweep(chosen.sweep))), chosen_workers(chosen))
    for name, value in load.figures.items():
        sys.stdout.write(f"{name} {value:.4g}\n")


if __name__ == "__main__":
    main()
