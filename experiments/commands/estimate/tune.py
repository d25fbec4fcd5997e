"""`softaim tune`."""

from __future__ import annotations

from experiments.commands.options import Minutes, RecordingFolder, Replace, SceneFile, SceneOut
from experiments.commands.run import Answer, Run


def tune(
    run: Run,
    recording: RecordingFolder,
    out: SceneOut,
    scene: SceneFile = None,
    minutes: Minutes = 5.0,
    force: Replace = False,
) -> Answer:
    """Estimate the size of model errors from a recording without truth, and write a scene with it."""
    from experiments.commands.console import levels_table
    from experiments.engine.spare import spare_cores
    from experiments.formats.outputs import check_new
    from experiments.formats.recording import read_recording
    from experiments.pipeline.identify import marks_in, time_lines, tuned_scene, tuning_report

    opened = read_recording(recording, scene, run.stage("read"))
    check_new(out, force)
    run.use(opened.scene, before="tune")
    with spare_cores(ahead=opened.marks is None) as workers:
        frames = marks_in(opened, run.stage("marks"))
        found_scene, found = tuned_scene(opened, frames, minutes, run.stage("tune"), workers)
    run.write_scene(found_scene, out, "tune", recording=recording, inputs=[scene])
    report = tuning_report(found)
    next_line = f"Scene in {out}; next: softaim track REC --scene {out} --out DIR"
    return Answer({"out": out, **report}, [levels_table(report), *time_lines(found, minutes), next_line])
