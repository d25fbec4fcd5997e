"""`softaim faults`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Force, Out, Processes, Scheduler
from experiments.commands.run import Answer, Run
from experiments.extras import require

PAGE = Path("docs") / "faults.md"


def faults(
    run: Run,
    out: Out,
    only: Annotated[
        list[str] | None, typer.Option("--only", help="Name of a fault to test; repeat for several; default: all.")
    ] = None,
    seeds: Annotated[int, typer.Option("--seeds", min=1, help="Number of runs of each fault.")] = 20,
    first_seed: Annotated[int, typer.Option("--first-seed", min=0, help="Seed of the first run.")] = 8000,
    processes: Processes = None,
    scheduler: Scheduler = None,
    force: Force = False,
    page: Annotated[bool, typer.Option("--page", help="Rewrite docs/faults.md in the current folder.")] = False,
) -> Answer:
    """Test live runs with faults of camera, tissue, needle and system; to resume, run again."""
    require("faults", "cluster", "live")
    run.not_with("--scheduler", "--processes")
    from experiments.commands.console import faults_table
    from experiments.engine.workers import Workers
    from experiments.formats.page import rewrite_page
    from experiments.studies.faults.study import cells, faults_study, markdown

    every = range(first_seed, first_seed + seeds)
    rows = faults_study(only or [], every, out, Workers(processes, scheduler), run.stage("faults"), force=force)
    if page:
        rewrite_page(PAGE, {"faults": markdown(rows)})
    run.finish(out, out)
    line = f"Table in {out / 'faults.csv'}; wrong GO: {rows['go_shown_while_faulty'].sum()}"
    record = {"out": out, "faults": json.loads(rows.to_json(orient="records"))}
    return Answer(record, [faults_table(cells(rows)), line])
