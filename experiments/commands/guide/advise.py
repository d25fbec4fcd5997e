"""`softaim advise`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Force, Out, SceneFile
from experiments.commands.terminal import progress


def advise(
    recording: Annotated[Path, typer.Argument(help="Folder of the recording.")],
    needle: Annotated[Path, typer.Option("--needle", help="The needle's file.", show_default=False)],
    out: Out,
    scene: SceneFile = None,
    force: Force = False,
) -> None:
    """Say for each frame whether a needle should go in, wait or turn: a table and a picture."""
    from experiments.commands.console import advice_line, reliability_line
    from experiments.formats.needle_file import read_needle
    from experiments.formats.outputs import output_folder
    from experiments.formats.recording import read_recording
    from experiments.pipeline.advise import advise as run
    from experiments.pipeline.advise import reliability, write_advice
    from experiments.pipeline.events import report_rest
    from experiments.plots.advice import write_advice_plot

    opened = read_recording(recording, scene)
    report_rest(opened.scene)
    plan = read_needle(needle, opened.scene.target.radius_m, opened.scene.network.dim)
    with output_folder(out, force=force, inputs=[recording]) as folder, progress() as stage:
        done = run(opened, plan, stage("advise"))
        write_advice(done, folder)
        write_advice_plot(done, folder)
    print(advice_line(done.counts()))
    if (line := reliability_line(reliability(done))) is not None:
        print(line)
    print(f"Table and picture in {out}")
