"""`softaim sweep`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Out, Processes, Scheduler
from experiments.commands.terminal import print_table, progress

MOST_SHOWN = 5
"""Failures that are printed; runs.csv has all."""


def sweep(
    study: Annotated[Path, typer.Argument(help="Sweep file: scenario, methods, seeds and a grid of parameters.")],
    out: Out,
    processes: Processes = None,
    scheduler: Scheduler = None,
) -> None:
    """Run a grid of simulated recordings: every combination, seed and method; run again, it goes on."""
    from experiments.commands.console import sweep_table
    from experiments.engine.workers import Workers
    from experiments.formats.sweep_file import read_sweep
    from experiments.pipeline.sweep import cells, run_sweep

    read = read_sweep(study)
    with progress() as stage:
        done = run_sweep(read, out, Workers(processes, scheduler), stage("sweep"))
    print_table(sweep_table(cells(done.summary)))
    print(f"{done.study.n_runs} runs, {done.study.n_done} of them now; tables in {out}")
    for line in done.study.failures[:MOST_SHOWN]:
        print(line, file=sys.stderr)
    if done.study.failures:
        print(f"softaim: {len(done.study.failures)} of {done.study.n_runs} runs failed", file=sys.stderr)
        raise typer.Exit(1)
