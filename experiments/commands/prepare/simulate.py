"""`softaim simulate`."""

from __future__ import annotations

from typing import Annotated

import typer

from experiments.commands.options import Force, Out
from experiments.commands.terminal import progress


def simulate(
    scenario: Annotated[str, typer.Argument(help="quiet, poked, paper-camera, or a scenario file.")],
    out: Out,
    force: Force = False,
) -> None:
    """Move and film a scenario: write a recording with its truth."""
    from experiments.formats.scenario import read_scenario
    from experiments.simulation.simulate import simulate as write_recording

    read = read_scenario(scenario)
    with progress() as stage:
        write_recording(read, out, force=force, advance=stage("film"))
    print(f"Recording in {out}; next: softaim track {out} --out {out}-track")
