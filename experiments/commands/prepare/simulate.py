"""`softaim simulate`."""

from __future__ import annotations

from typing import Annotated

import typer

from experiments.commands.options import Force, Out, ScenarioName
from experiments.commands.run import Answer, Run


def simulate(
    run: Run,
    scenario: ScenarioName,
    out: Out,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="In place of the scenario's own.")] = None,
    runs: Annotated[
        int | None, typer.Option("--runs", min=1, help="So many recordings, of successive seeds, in OUT/seed-N.")
    ] = None,
    film: Annotated[bool, typer.Option("--film/--no-film", help="Without: marks.csv, where a film could be.")] = True,
    force: Force = False,
) -> Answer:
    """Move a scenario's tissue and film it, or note its marks: write a recording with its truth."""
    from experiments.errors import InputError
    from experiments.formats.scenario import STEPS, read_scenario, scenario_file, scene_file
    from experiments.simulation.simulate import scene_of
    from experiments.simulation.simulate import simulate as write_recording

    read = read_scenario(scenario)
    if "--film" in run.given and not scene_of(read).cameras:
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

    def show() -> None:
        own = scenario_file(scenario)
        if own is not None and own.with_name(STEPS).exists():  # of a project, each recording has a next step of its own
            print(f"Recording{'s' if runs else ''} in {out}; next: what {own.with_name(STEPS)} has after this line")
        elif runs is None:
            print(f"Recording in {out}; next: softaim track {out} --out {out}-track")
        else:
            where = f"{out}/{names[0]}"
            print(f"{runs} recordings in {where} ...; next: softaim track {where} --out {out}-track")

    return Answer({"out": out, "recordings": [out / name for name in names]}, show)
