"""Subcommands for the needle: advice, planning, and simulated insertion."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from experiments.commands.options import (
    Force,
    Out,
    Processes,
    RecordingFolder,
    ScenarioName,
    SceneFile,
    Scheduler,
    Vector,
    WithFilm,
)
from experiments.commands.run import Answer, Run
from experiments.errors import InputError


def advise(
    run: Run,
    recording: RecordingFolder,
    needle: Annotated[Path, Option(help="Needle file.", show_default=False)],
    out: Out,
    scene: SceneFile = None,
    film: WithFilm = False,
    vector: Vector = None,
    force: Force = False,
) -> Answer:
    """Advise for each frame whether to insert, wait, realign or abort; write a table and a picture."""
    import numpy as np

    from experiments.commands.console import advice_line, reliability_line
    from experiments.film.film import Film
    from experiments.formats.needle_file import read_needle
    from experiments.formats.recording import read_recording
    from experiments.pipeline.advise import advise as advised
    from experiments.pipeline.advise import push_m, reliability, write_advice
    from experiments.plots.advice import advice_figure
    from experiments.plots.style import write_picture

    opened = read_recording(recording, scene, run.stage("read"))
    plan = read_needle(needle, opened.scene.target.radius_m, opened.scene.network.dim)
    with run.folder(out, force=force, inputs=[recording, scene, needle]) as folder:
        run.use(opened.scene, before="track")
        with Film(folder, opened, plan) if film else nullcontext() as watch:
            done = advised(opened, plan, run.stage("advise"), watch=watch)
        write_advice(done, folder)
        write_picture(advice_figure(done), folder / "advice.png", vector)
    counts, reliable = done.counts(), reliability(done)
    pushed_mm = 1e3 * float(np.linalg.norm(push_m(opened.scene, plan)))
    lines = [advice_line(counts)]
    if (line := reliability_line(reliable)) is not None:
        lines.append(line)
    if pushed_mm > 0.0:
        lines.append(f"Predicted push of the needle on the target: {pushed_mm:.2g} mm ± {plan.forces.error:.0%}")
    record = {"frames": len(done.times_s), "advice": counts, "reliability": reliable, "push_mm": pushed_mm}
    return Answer({"out": out, **record}, [*lines, f"Table and picture in {out}"])


def plan(
    run: Run,
    source: Annotated[Path, Argument(help="Folder of a recording, or a scene file for tissue at rest.")],
    out: Out,
    plan_file: Annotated[Path, Option("--plan", help="Plan file: needle, skin and obstacles.")],
    scene: SceneFile = None,
    vector: Vector = None,
    force: Force = False,
) -> Answer:
    """Rank straight needle paths by hit probability, considering the needle's push on the target."""
    from experiments.commands.console import plan_table
    from experiments.pipeline.plan import planned, report, write_plan
    from experiments.plots.plan import plan_figure
    from experiments.plots.style import write_picture

    with run.folder(out, force=force, inputs=[source, plan_file, scene]) as folder:
        done = planned(source, plan_file, scene, run.stage)
        run.use(done.scene, before="track")
        write_plan(done, folder)
        write_picture(plan_figure(done), folder / "plan.png", vector)
    figures = report(done)
    none = f"No path is allowed; reasons in {out / 'plan.csv'}"
    shown = none if figures["best"] is None else plan_table(figures)
    return Answer({"out": out, "plan": figures}, [shown, f"Table and picture in {out}"])


def insert(
    run: Run,
    scenario: ScenarioName,
    out: Out,
    runs: Annotated[int, Option(min=1, help="Number of runs of each policy.")] = 2000,
    scene: Annotated[Path | None, Option(help="Scene of the filter; default: the scene of the scenario.")] = None,
    needle: Annotated[Path | None, Option(help="Needle file; default: insertion from above.")] = None,
    seed: Annotated[int | None, Option(min=0, help="Seed of the first run.")] = None,
    speed_mm_s: Annotated[float | None, Option(min=10.0, max=1000.0, help="Needle speed [mm/s]; default: 50.")] = None,
    radius_mm: Annotated[
        float | None, Option(help="Radius of the lesion [mm]; default: from needle file or scene, else 5.")
    ] = None,
    advice: Annotated[
        bool, Option("--advice/--no-advice", help="Also evaluate `softaim advise`; triples the time.")
    ] = True,
    strength: Annotated[float, Option(min=0.01, max=1000.0, help="Factor on the forces of pokes and breathing.")] = 1.0,
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
