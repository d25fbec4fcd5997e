"""`softaim track`."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Annotated

import typer

from experiments.commands.options import Force, Out, RecordingFolder, SceneFile, Vector, WithFilm
from experiments.commands.run import Answer, Run


def track(
    run: Run,
    recording: RecordingFolder,
    out: Out,
    scene: SceneFile = None,
    check: Annotated[
        bool,
        typer.Option(
            "--check", help="Predict each mark from the others; if errors are too large, enlarge covariances."
        ),
    ] = False,
    film: WithFilm = False,
    vector: Vector = None,
    force: Force = False,
) -> Answer:
    """Track the hidden target in a recording with the paper's method and Softaim's filter; write tables and plots."""
    from experiments.commands.console import fit_lines, marks_table, sentence, track_table, withheld_table
    from experiments.film.film import Film
    from experiments.formats.recording import read_recording
    from experiments.pipeline.events import report_move, report_swap
    from experiments.pipeline.line import FILTER
    from experiments.pipeline.scores.fit import withheld_words
    from experiments.pipeline.track import summary, write_tables
    from experiments.pipeline.track import track as tracked
    from experiments.plots.track import write_track_plots

    opened = read_recording(recording, scene, run.stage("read"))
    with run.folder(out, force=force, inputs=[recording, scene]) as folder:
        run.use(opened.scene, before="track")
        with Film(folder, opened) if film else nullcontext() as watch:
            done = tracked(opened, run.stage("track"), check=check, watch=watch)
        write_tables(done, folder)
        write_track_plots(done, folder, vector, advance=run.stage("pictures"))
        for step in done.steps:
            if step.swap is not None:
                report_swap(step.swap)
            for camera, moved in step.reference.moves.items() if step.reference is not None else ():
                report_move(moved, camera)
    figures = summary(done)
    ours = figures[FILTER]
    shown = [track_table(figures), *fit_lines(ours)]
    if any(one.found < 1.0 for one in done.marks.values()):
        shown.append(marks_table(ours))
    if ours.get("marks_verdict"):
        shown.append(sentence(ours["marks_verdict"]))
    if check and done.withheld:
        shown.append(withheld_table(ours))
    if check:
        shown.append(sentence(withheld_words(done.withheld, float(done.counts["check_scale"] or 1.0))))
    return Answer({"out": out, "summary": figures}, [*shown, f"Tables and pictures in {out}"])
