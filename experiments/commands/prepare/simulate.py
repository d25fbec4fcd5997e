"""`softaim simulate`."""

from __future__ import annotations

from typing import Annotated

import typer

from experiments.commands.options import Force, Out, ScenarioName
from experiments.commands.run import Answer, Run
from experiments.errors import InputError


def simulate(
    run: Run,
    scenario: ScenarioName,
    out: Out,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Seed; replaces the scenario's.")] = None,
    runs: Annotated[
        int | None, typer.Option("--runs", min=1, help="Number of recordings OUT/seed-N, with successive seeds.")
    ] = None,
    film: Annotated[bool, typer.Option("--film/--no-film", help="Write a film; with --no-film only marks.csv.")] = True,
    force: Force = False,
) -> Answer:
    """Simulate a scenario's tissue; write a recording with film or marks, and true positions."""
    from experiments.formats.scenario import STEPS, read_scenario, scenario_file, scene_file
    from experiments.simulation.simulate import scene_of
    from experiments.simulation.simulate import simulate as write_recording

    read = read_scenario(scenario)
    given = scene_of(read)
    if "--film" in run.given and not (given.cameras or given.space_cameras):
        raise InputError.at("--film", "a scene with a camera", "none")
    first = read.seed if seed is None else seed
    names = [""] if runs is None else [f"seed-{first + k}" for k in range(runs)]
    with run.folder(out, force=force, inputs=[scenario_file(scenario), scene_file(read)]) as folder:
        run.use(scene_of(read), before="simulate")
        advance = run.stage("simulate")
        for k, name in enumerate(names):
            write_recording(
                read.model_copy(update={"seed": first + k}),
                folder / name,
                filmed=film,
                advance=lambda share, done=k: advance((done + share) / len(names)),  # type: ignore[misc]
            )
    own = scenario_file(scenario)
    steps = None if own is None else own.with_name(STEPS)
    page = steps.read_text("utf-8", "replace") if steps is not None and steps.is_file() else ""
    if own is not None and f"simulate {own.name} " in page:  # in a project each recording has its own next step
        line = f"Recording{'s' if runs else ''} in {out}; next: the following step in {steps}"
    elif runs is None:
        line = f"Recording in {out}; next: softaim track {out} --out {out}-track"
    else:
        where = f"{out}/{names[0]}"
        line = f"{runs} recordings in {where} ...; next: softaim track {where} --out {out}-track"
    return Answer({"out": out, "recordings": [out / name for name in names]}, [line])
