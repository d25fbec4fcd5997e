"""`softaim advise`."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Force, Out, RecordingFolder, SceneFile, Vector, WithFilm
from experiments.commands.run import Answer, Run


def advise(
    run: Run,
    recording: RecordingFolder,
    needle: Annotated[Path, typer.Option("--needle", help="Needle file.", show_default=False)],
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
    from experiments.plots.advice import write_advice_plot

    opened = read_recording(recording, scene, run.stage("read"))
    plan = read_needle(needle, opened.scene.target.radius_m, opened.scene.network.dim)
    with run.folder(out, force=force, inputs=[recording, scene, needle]) as folder:
        run.use(opened.scene, before="track")
        with Film(folder, opened, plan) if film else nullcontext() as watch:
            done = advised(opened, plan, run.stage("advise"), watch=watch)
        write_advice(done, folder)
        write_advice_plot(done, folder, vector)
    counts, reliable = done.counts(), reliability(done)
    pushed_mm = 1e3 * float(np.linalg.norm(push_m(opened.scene, plan)))
    lines = [advice_line(counts)]
    if (line := reliability_line(reliable)) is not None:
        lines.append(line)
    if pushed_mm > 0.0:
        lines.append(f"Predicted push of the needle on the target: {pushed_mm:.2g} mm ± {plan.forces.error:.0%}")
    record = {"frames": len(done.times_s), "advice": counts, "reliability": reliable, "push_mm": pushed_mm}
    return Answer({"out": out, **record}, [*lines, f"Table and picture in {out}"])
