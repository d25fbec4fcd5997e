"""`softaim identify`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import AsJson, Minutes, SceneFile, SceneOut
from experiments.commands.terminal import print_table, progress


def identify(
    recording: Annotated[Path, typer.Argument(help="Calibration recording in which the hidden mark is seen, too.")],
    out: SceneOut,
    scene: SceneFile = None,
    at_rest: Annotated[
        bool, typer.Option("--at-rest", help="The tissue rests: correct its rest lengths only.")
    ] = False,
    minutes: Minutes = 5.0,
    as_json: AsJson = False,
) -> None:
    """Find the tissue's constants: write a scene to track with, state how well each is known."""
    from experiments.commands.console import constants_table
    from experiments.formats.recording import read_recording
    from experiments.formats.scene.scene import write_scene
    from experiments.pipeline.identify import (
        fit_lines,
        identification_report,
        identified_scene,
        marks_in,
        resting_scene,
    )

    opened = read_recording(recording, scene)
    with progress() as stage:
        frames = marks_in(opened, stage("marks"))
        if at_rest:
            write_scene(resting_scene(opened, frames), out)
        else:
            found_scene, found = identified_scene(opened, frames, minutes, stage("identify"))
            write_scene(found_scene, out)
    if at_rest:
        print(f"Scene in {out}: it rests where the recording shows it")
    elif as_json:
        print(json.dumps(identification_report(found), indent=2))
    else:
        print_table(constants_table(identification_report(found)))
        print("\n".join(fit_lines(found, minutes)))
        print(f"Scene in {out}; next: softaim track REC --scene {out} --out DIR")
