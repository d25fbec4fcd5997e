"""`softaim insert`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Force, Out, Processes, ScenarioName, Scheduler, Vector
from experiments.commands.run import Answer, Run
from experiments.errors import InputError


def insert(
    run: Run,
    scenario: ScenarioName,
    out: Out,
    runs: Annotated[int, typer.Option("--runs", min=1, help="Number of runs of each policy.")] = 2000,
    scene: Annotated[Path | None, typer.Option("--scene", help="Scene of the filter; default: the scenario's.")] = None,
    needle: Annotated[Path | None, typer.Option("--needle", help="Needle file; default: insertion from above.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Seed of the first run.")] = None,
    speed_mm_s: Annotated[
        float | None, typer.Option("--speed-mm-s", min=10.0, max=1000.0, help="Needle speed [mm/s]; default: 50.")
    ] = None,
    radius_mm: Annotated[
        float | None,
        typer.Option("--radius-mm", help="Radius of the lesion [mm]; default: from needle file or scene, else 5."),
    ] = None,
    advice: Annotated[
        bool,
        typer.Option("--advice/--no-advice", help="Also evaluate `softaim advise`; triples the time."),
    ] = True,
    strength: Annotated[
        float, typer.Option("--strength", min=0.01, max=1000.0, help="Factor on the forces of pokes and breathing.")
    ] = 1.0,
    processes: Processes = None,
    scheduler: Scheduler = None,
    vector: Vector = None,
    force: Force = False,
) -> Answer:
    """Insert a simulated needle into moving tissue with five policies; report misses, predicted and observed hits."""
    run.not_with("--scheduler", "--processes")
    from experiments.commands.console import insertion_lines, insertion_table
    from experiments.engine.workers import Workers, workers_for
    from experiments.formats.scenario import read_scenario, scenario_file, scene_file
    from experiments.plots.insertion import write_insertion_plots
    from experiments.simulation.cases import case_of
    from experiments.simulation.insert import insert as inserted
    from experiments.simulation.insert import summary, write_insertions

    read = read_scenario(scenario)
    if "--strength" in run.given and read.pokes is None and read.breathing is None:
        raise InputError.at("--strength", "a scenario with pokes or breathing", "neither")
    case = case_of(
        read,
        scene_path=scene,
        needle_path=needle,
        speed_m_s=None if speed_mm_s is None else 1e-3 * speed_mm_s,
        radius_m=None if radius_mm is None else 1e-3 * radius_mm,
        strength=strength,
    )
    case = replace(case, seed=case.seed if seed is None else seed, advice=advice)
    with run.folder(out, force=force, inputs=[scenario_file(scenario), scene_file(read), scene, needle]) as folder:
        run.use(case.given, before="insert")
        workers = workers_for(runs, Workers(processes, scheduler))
        done = inserted(case, runs, run.stage("insert"), workers=workers)
        write_insertions(done, folder)
        write_insertion_plots(done, folder, vector)
    report = summary(done)
    lines = [*insertion_lines(report), f"Tables and pictures in {out}"]
    return Answer({"out": out, "summary": report}, [insertion_table(report), *lines])
