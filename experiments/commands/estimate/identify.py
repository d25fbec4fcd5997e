"""`softaim identify`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Minutes, Replace, SceneFile, SceneOut
from experiments.commands.run import Answer, Run


def identify(
    run: Run,
    recording: Annotated[Path, typer.Argument(help="Calibration recording that also shows the target's mark.")],
    out: SceneOut,
    scene: SceneFile = None,
    at_rest: Annotated[
        bool, typer.Option("--at-rest", help="Correct only rest lengths, from a recording at rest.")
    ] = False,
    minutes: Minutes = 5.0,
    force: Replace = False,
) -> Answer:
    """Estimate the tissue's constants and their uncertainty, and write a scene with them."""
    run.not_with("--at-rest", "--minutes")
    from experiments.commands.console import constants_table
    from experiments.engine.spare import spare_cores
    from experiments.formats.outputs import check_new
    from experiments.formats.recording import read_recording
    from experiments.pipeline.identify import (
        check_shown,
        constants,
        fit_lines,
        identification_report,
        identified_scene,
        marks_in,
        resting_scene,
    )

    opened = read_recording(recording, scene, run.stage("read"))
    check_new(out, force)
    run.use(opened.scene, before=None if at_rest else "identify")
    network = opened.scene.network
    check_shown(opened, [network.names[i] for i in network.free] if at_rest else [opened.scene.target.node])
    if at_rest:
        frames = marks_in(opened, run.stage("marks"))
        run.write_scene(resting_scene(opened, frames), out, "at-rest", recording=recording, inputs=[scene])
        next_line = f"next: softaim identify CALIBRATION --scene {out} --out identified.toml"
        rests = f"Scene in {out}, with the rest shape of the recording; {next_line}"
        return Answer({"out": out}, [rests])
    with spare_cores(ahead=opened.marks is None) as workers:
        frames = marks_in(opened, run.stage("marks"))
        found_scene, found = identified_scene(opened, frames, minutes, run.stage("identify"), workers)
    report = identification_report(found, found_scene.mesh)
    kept = [one["name"] for one in constants(found, found_scene.mesh) if one["kept"]]
    run.write_scene(found_scene, out, "identify", recording=recording, inputs=[scene], kept=kept)
    next_line = f"Scene in {out}; next: softaim tune REC --out tuned.toml --scene {out}"
    return Answer({"out": out, **report}, [constants_table(report), *fit_lines(found, minutes), next_line])
