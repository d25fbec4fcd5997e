"""`softaim insert`."""

from __future__ import annotations

from typing import Annotated

import typer

from experiments.commands.options import Force, Out, Processes, ScenarioName, Scheduler
from experiments.commands.run import Answer, Run
from experiments.commands.terminal import print_table


def insert(
    run: Run,
    scenario: ScenarioName,
    out: Out,
    runs: Annotated[int, typer.Option("--runs", min=1, help="Worlds in which every policy is tried.")] = 2000,
    speed_mm_s: Annotated[float, typer.Option("--speed-mm-s", min=10.0, max=1000.0, help="Of the needle.")] = 50.0,
    radius_mm: Annotated[float, typer.Option("--radius-mm", help="Of the lesion.")] = 5.0,
    strength: Annotated[float, typer.Option("--strength", min=0.01, help="Factor on pokes and breathing.")] = 1.0,
    processes: Processes = None,
    scheduler: Scheduler = None,
    force: Force = False,
) -> Answer:
    """Drive a simulated needle into moving tissue by five policies: hit rates, misses, whether odds came true."""
    from experiments.commands.console import insertion_table
    from experiments.engine.workers import Workers, workers_for
    from experiments.formats.scenario import read_scenario, scenario_file
    from experiments.plots.insertion import write_insertion_plots
    from experiments.simulation.insert import case_of, summary, write_insertions
    from experiments.simulation.insert import insert as inserted

    case = case_of(read_scenario(scenario), speed_m_s=1e-3 * speed_mm_s, strength=strength)
    with run.folder(out, force=force, inputs=[scenario_file(scenario)]) as folder:
        workers = workers_for(runs, Workers(processes, scheduler))
        done = inserted(case, runs, 1e-3 * radius_mm, run.stage("insert"), workers=workers)
        write_insertions(done, folder)
        write_insertion_plots(done, folder)
    report = summary(done)

    def show() -> None:
        print_table(insertion_table(report))
        print(f"Tables and pictures in {out}")

    return Answer({"out": out, "summary": report}, show)
