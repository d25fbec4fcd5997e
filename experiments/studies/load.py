"""Overhead of the engine beyond the runs, and the use of the cores.

    python -m experiments.studies.load                          # 2,000 runs of 50 ms of processor time each
    python -m experiments.studies.load --sweep STUDY.toml       # those of a sweep

prints runs, processes, wall time and the share of all processes' time that was spent in runs; and the overhead of a
run, in wall time of a process (start and end of the cluster included) and in processor time of all processes together.
On a busy machine the latter is the reliable one. Figures: docs/sweep.md.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from experiments.engine.progress import run_bar
from experiments.engine.runs import Case, Work
from experiments.engine.study import run_study
from experiments.engine.workers import Workers, chosen_workers
from experiments.studies.grid import study_options


def busy(case: Case) -> dict[str, float]:
    """A run with this processor time [ms]."""
    until = time.process_time() + 1e-3 * case["ms"]
    while time.process_time() < until:
        pass
    return {"cpu_s": 1e-3 * case["ms"]}


def timed(case: Case, work: Work) -> list[dict[str, object]]:
    """The rows of a run, with its processor time."""
    began = time.process_time()
    rows = work(case)
    return [{**row, "cpu_s": time.process_time() - began} for row in rows]


def measured(work: Work, cases: list[Case], workers: Workers) -> dict[str, float]:
    """Times of these runs; work returns `cpu_s`, the processor time of a run."""
    cpu_s: list[float] = []

    def advance(share: float) -> None:
        bar(share)
        if share in (0.0, 1.0):  # the workers still exist
            cpu_s.append(_cpu_s())

    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder, run_bar("load") as bar:
        table = run_study(work, cases, Path(folder), workers, advance).checked().drop_duplicates("key")
    wall_s = time.perf_counter() - began
    return figures(len(cases), workers.n_local, wall_s, cpu_s[-1] - cpu_s[0], table[["seconds", "cpu_s"]].sum())


def figures(n_runs: int, n_processes: int, wall_s: float, cpu_s: float, runs: Mapping[str, float]) -> dict[str, float]:
    """Figures from wall time and processor time of all [s], and both, `seconds` and `cpu_s`, summed over the runs."""
    return {
        "runs": n_runs,
        "processes": n_processes,
        "wall_s": wall_s,
        "busy": runs["seconds"] / (n_processes * wall_s),
        "beyond_a_run_ms": 1e3 * (n_processes * wall_s - runs["seconds"]) / n_runs,
        "beyond_a_run_cpu_ms": 1e3 * (cpu_s - runs["cpu_s"]) / n_runs,
    }


def _cpu_s() -> float:
    """Processor time of this process and of all existing child processes [s]."""
    import psutil

    own = psutil.Process()
    used = [process.cpu_times() for process in (own, *own.children(recursive=True))]
    return sum(one.user + one.system for one in used)


def main() -> None:
    """Print the figures."""
    parser = study_options(__doc__, out=False)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--ms", type=float, default=50.0, help="processor time of a run")
    parser.add_argument("--sweep", type=Path, help="runs of this sweep file in place of synthetic ones")
    given = parser.parse_args()
    workers = chosen_workers(given)
    if given.sweep is None:
        found = measured(busy, [{"seed": seed, "ms": given.ms} for seed in range(given.runs)], workers)
    else:
        # imported here, so that synthetic runs do not wait for the filters
        from experiments.formats.sweep_file import read_sweep
        from experiments.pipeline.sweep import cases_of, swept_rows

        with tempfile.TemporaryDirectory() as truths:
            work = partial(timed, work=partial(swept_rows, truths=Path(truths)))
            found = measured(work, list(cases_of(read_sweep(given.sweep))), workers)
    for name, value in found.items():
        sys.stdout.write(f"{name} {value:.4g}\n")


if __name__ == "__main__":
    main()
