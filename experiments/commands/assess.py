"""Subcommands for assessment: demonstration, benchmark, sweeps and faults."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from experiments.commands.options import Force, Out, Processes, Scheduler, Vector
from experiments.commands.run import Answer, Run
from experiments.extras import require
from experiments.log import LOG
from experiments.plain import counted


def demo(run: Run, out: Out = Path("demo"), vector: Vector = None, force: Force = False) -> Answer:
    """Simulate, film and track the two scenarios of the paper, and compare errors with the published ones."""
    from experiments.commands.console import demo_table
    from experiments.studies.demo import demo as done

    with run.folder(out, force=force) as folder:
        figures = done(folder, vector=vector, stage=run.stage)
    pictures = (
        f"Pictures: {out / name / 'path.png'}, error.png, sigma.png, consistency.png beside it" for name in figures
    )
    verdicts = f"All figures, with a verdict for each: {out / 'summary.json'}"
    return Answer({"out": out, "summary": figures}, [demo_table(figures), *pictures, verdicts])


MOST_SHOWN = 5
"""Largest number of printed failures; runs.csv has all failures."""


def sweep(
    run: Run,
    study: Annotated[Path, Argument(help="Sweep file: scenario, methods, seeds and parameter grid.")],
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


def bench(run: Run) -> Answer:
    """Measure the speed of the filter, the live loop and reference implementations."""
    from experiments.commands.console import bench_table
    from experiments.studies.bench import bench as measured

    report = measured(run.stage("bench"))
    return Answer(report, [bench_table(report)])


PAGE = Path("docs") / "faults.md"


def faults(
    run: Run,
    out: Out,
    only: Annotated[
        list[str] | None, Option(help="Fault to test; repeat for several faults; default: all faults.")
    ] = None,
    seeds: Annotated[int, Option(min=1, help="Number of runs of each fault.")] = 20,
    first_seed: Annotated[int, Option(min=0, help="Seed of the first run.")] = 8000,
    processes: Processes = None,
    scheduler: Scheduler = None,
    force: Force = False,
    page: Annotated[bool, Option("--page", help="Rewrite docs/faults.md in the current folder.")] = False,
) -> Answer:
    """Test live runs with faults of camera, tissue, needle and system; to resume, run again."""
    require("faults", "cluster", "live")
    run.not_with("--scheduler", "--processes")
    run.not_with("--page", "--only")
    from experiments.commands.console import faults_table
    from experiments.engine.workers import Workers
    from experiments.errors import read_text
    from experiments.formats.page import rewrite_page
    from experiments.studies.faults.study import cells, faults_study, markdown

    if page:
        read_text(PAGE)  # raises InputError before the hours of runs
    every = range(first_seed, first_seed + seeds)
    rows = faults_study(only or [], every, out, Workers(processes, scheduler), run.stage("faults"), force=force)
    if page:
        rewrite_page(PAGE, {"faults": markdown(rows)})
    run.finish(out, out)
    line = f"Table in {out / 'faults.csv'}; wrong GO: {rows['go_shown_while_faulty'].sum()}"
    record = {"out": out, "faults": json.loads(rows.to_json(orient="records"))}
    return Answer(record, [faults_table(cells(rows)), line])
