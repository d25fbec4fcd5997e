"""`softaim tune`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import AsJson, Minutes, SceneFile, SceneOut
from experiments.commands.terminal import print_table, progress


def tune(
    recording: Annotated[Path, typer.Argument(help="Folder of the recording.")],
    out: SceneOut,
    scene: SceneFile = None,
    minutes: Minutes = 5.0,
    as_json: AsJson = False,
) -> None:
    """Find the noise levels under which a recording is most probable; no truth is needed. Write a scene with them."""
    from experiments.commands.console import levels_table
    from experiments.formats.recording import read_recording
    from experiments.formats.scene.scene import write_scene
    from experiments.pipeline.events import report_rest
    from experiments.pipeline.identify import marks_in, tuned_scene, tuning_report

    opened = read_recording(recording, scene)
    report_rest(opened.scene)
    with progress() as stage:
        frames = marks_in(opened, stage("marks"))
        found_scene, found = tuned_scene(opened, frames, minutes, stage("tune"))
        write_scene(found_scene, out)
    if as_json:
        print(json.dumps(tuning_report(found), indent=2))
    else:
        print_table(levels_table(tuning_report(found)))
        if not found.in_time:
            print(f"The best within {minutes:g} minutes, by {found.n_frames} frames: --minutes for more")
        print(f"Scene in {out}; next: softaim track REC --scene {out} --out DIR")
