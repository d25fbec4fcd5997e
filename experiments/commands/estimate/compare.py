"""`softaim compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Force, Out, SceneFile
from experiments.commands.terminal import print_table, progress


def compare(
    recording: Annotated[Path, typer.Argument(help="Folder of the recording.")],
    out: Out,
    scene: SceneFile = None,
    methods: Annotated[str | None, typer.Option("--methods", help="Which, separated by commas; default: all.")] = None,
    force: Force = False,
) -> None:
    """Follow the target by the paper's method, ours and textbook filters, on the same marks."""
    from experiments.commands.console import sentence, track_table
    from experiments.formats.outputs import output_folder
    from experiments.formats.recording import read_recording
    from experiments.pipeline.compare import chosen, summary, write_comparison
    from experiments.pipeline.compare import compare as run
    from experiments.pipeline.events import report_rest
    from experiments.pipeline.line import FILTER
    from experiments.pipeline.track import verdict_of
    from experiments.plots.compare import write_comparison_plot

    named = chosen(methods)
    opened = read_recording(recording, scene)
    report_rest(opened.scene)
    with output_folder(out, force=force, inputs=[recording]) as folder, progress() as stage:
        done = run(opened, named, stage)
        write_comparison(done, folder)
        write_comparison_plot(done, folder)
    print_table(track_table(summary(done)))
    print(f"{FILTER}: {sentence(verdict_of(done))}")
    print(f"Tables and a picture in {out}")
