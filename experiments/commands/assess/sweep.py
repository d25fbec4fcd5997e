"""`softaim sweep`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Force, Out, Processes, Scheduler
from experiments.commands.run import Answer, Run
from experiments.extras import require
from experiments.log import LOG
from experiments.plain import counted

MOST_SHOWN = 5
"""Largest number of failures that are printed; runs.csv has all."""


def sweep(
    run: Run,
    study: Annotated[Path, typer.Argument(help="Sweep file: scenario, methods, seeds and parameter grid.")],
    out: Out,
    processes: Processes = None,
    scheduler: Scheduler = None,
    force: Force = False,
) -> Answer:
    """Run methods on simulated recordings over a parameter grid and seeds; to resume, run again."""
    require("sweep", "cluster")
    run.not_with("--scheduler", "--processes")
    from experiments.commands.console import sweep_table
    from experiments.engine.workers import Workers
    from experiments.formats.sweep_file import read_sweep
    from experiments.pipeline.sweep import cells, run_sweep

    read = read_sweep(study)
    done, summary = run_sweep(read, out, Workers(processes, scheduler), run.stage("sweep"), force=force)
    failed = done.failures
    for line in failed[:MOST_SHOWN]:
        LOG.warning("%s", line)
    if failed:
        LOG.warning("%d of %d runs failed", len(failed), done.n_runs)
    run.finish(out, out, [study, read.scenario, read.scene])
    line = f"{counted(done.n_runs, 'run')}, {done.n_done} of them new; tables in {out}"
    record = {
        "out": out,
        "runs": done.n_runs,
        "done_now": done.n_done,
        "failures": list(failed),
        "summary": json.loads(summary.to_json(orient="records")),
    }
    return Answer(record, [sweep_table(cells(summary)), line], typer.Exit(1) if failed else None)
