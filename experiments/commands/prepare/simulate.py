"""`softaim simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Force, Out
from experiments.commands.terminal import progress

SHIPPED = ", ".join(sorted(path.stem for path in Path(__file__).parents[2].glob("scenarios/*.toml")))
"""Names of the scenarios that come with the program, listed without loading what reads them."""


def simulate(
    scenario: Annotated[str, typer.Argument(help=f"A scenario file, or one that comes along: {SHIPPED}.")],
    out: Out,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="In place of the scenario's own.")] = None,
    runs: Annotated[
        int | None, typer.Option("--runs", min=1, help="So many recordings, of successive seeds, in OUT/seed-N.")
    ] = None,
    film: Annotated[bool, typer.Option("--film/--no-film", help="Without: marks.csv, where a film could be.")] = True,
    force: Force = False,
) -> None:
    """Move a scenario's tissue and film it, or note its marks: write a recording with its truth."""
    from experiments.formats.outputs import output_folder
    from experiments.formats.scenario import read_scenario
    from experiments.pipeline.events import report_rest
    from experiments.simulation.simulate import scene_of
    from experiments.simulation.simulate import simulate as write_recording

    read = read_scenario(scenario)
    first = read.seed if seed is None else seed
    report_rest(scene_of(read))
    if runs is None:
        with progress() as stage:
            of_seed = read.model_copy(update={"seed": first})
            write_recording(of_seed, out, force=force, filmed=film, advance=stage("simulate"))
        print(f"Recording in {out}; next: softaim track {out} --out {out}-track")
        return
    with output_folder(out, force=force) as folder, progress() as stage:
        advance = stage("simulate")
        for k in range(runs):
            of_seed = read.model_copy(update={"seed": first + k})
            write_recording(
                of_seed,
                folder / f"seed-{first + k}",
                filmed=film,
                advance=lambda share, done=k: advance((done + share) / runs),  # type: ignore[misc]
            )
    print(f"{runs} recordings in {out}/seed-{first} ...; next: softaim track {out}/seed-{first} --out {out}-track")
