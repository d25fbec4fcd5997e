"""`softaim compare`."""

from __future__ import annotations

from typing import Annotated

import typer

from experiments.commands.options import Force, Out, RecordingFolder, SceneFile, Vector
from experiments.commands.run import Answer, Run


def compare(
    run: Run,
    recording: RecordingFolder,
    out: Out,
    scene: SceneFile = None,
    methods: Annotated[
        str | None, typer.Option("--methods", help="Names of methods, separated by commas; default: all.")
    ] = None,
    vector: Vector = None,
    force: Force = False,
) -> Answer:
    """Track the target with the paper's method, Softaim's filter and textbook filters, on the same marks."""
    from experiments.commands.console import sentence, track_table
    from experiments.formats.recording import read_recording
    from experiments.pipeline.compare import chosen, summary, write_comparison
    from experiments.pipeline.compare import compare as compared
    from experiments.pipeline.line import FILTER
    from experiments.pipeline.track import verdict_of
    from experiments.plots.compare import write_comparison_plot

    named = chosen(methods)
    opened = read_recording(recording, scene, run.stage("read"))
    with run.folder(out, force=force, inputs=[recording, scene]) as folder:
        run.use(opened.scene, before="track")
        done = compared(opened, named, run.stage)
        write_comparison(done, folder)
        write_comparison_plot(done, folder, vector)
    figures = summary(done)
    lines = [f"{FILTER}: {sentence(verdict_of(done))}", f"Tables and a picture in {out}"]
    return Answer({"out": out, "summary": figures}, [track_table(figures), *lines])
