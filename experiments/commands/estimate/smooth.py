"""`softaim smooth`."""

from __future__ import annotations

from experiments.commands.options import Force, Out, RecordingFolder, SceneFile, Vector
from experiments.commands.run import Answer, Run


def smooth(
    run: Run, recording: RecordingFolder, out: Out, scene: SceneFile = None, vector: Vector = None, force: Force = False
) -> Answer:
    """Estimate the target at each frame from the marks of all frames, including later ones."""
    from experiments.commands.console import track_table
    from experiments.formats.recording import read_recording
    from experiments.pipeline.compare import SMOOTHER, compare, summary, write_smoothed
    from experiments.plots.compare import write_comparison_plot

    opened = read_recording(recording, scene, run.stage("read"))
    with run.folder(out, force=force, inputs=[recording, scene]) as folder:
        run.use(opened.scene, before="track")
        done = compare(opened, [SMOOTHER], run.stage)
        write_smoothed(done, folder)
        write_comparison_plot(done, folder, vector)
    figures = summary(done)
    line = f"Tables and a picture in {out}; estimates.csv has the smoother's estimates"
    return Answer({"out": out, "summary": figures}, [track_table(figures), line])
