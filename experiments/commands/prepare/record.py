"""`softaim record`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Force, Fps
from experiments.commands.run import Answer, Run
from experiments.errors import InputError
from experiments.plain import counted


def record(
    run: Run,
    source: Annotated[
        list[str] | None,
        typer.Argument(
            help="Camera index, device, film, folder, stream, recording, phantom; for several: NAME=SOURCE each."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder of the recording; new or empty.")] = None,
    scene: Annotated[Path | None, typer.Option("--scene", help="Scene file to copy into the recording.")] = None,
    codec: Annotated[str, typer.Option("--codec", help="FFV1: lossless; MJPG: smaller files.")] = "FFV1",
    seconds: Annotated[float | None, typer.Option("--seconds", min=0.0, help="Stop after this time [s].")] = None,
    fps: Fps = None,
    recover: Annotated[
        Path | None, typer.Option("--recover", help="Folder of a killed recording; joins its pieces to a film.")
    ] = None,
    force: Force = False,
) -> Answer:
    """Record frames and their times until Ctrl-C; a killed recording loses at most its last second."""
    run.not_with("--recover", "--scene", "--codec", "--seconds", "--fps", "--force")
    from experiments.pipeline.recorder import join, record_source

    if recover is not None and not source and out is None:
        n_frames = join(recover, run.stage("join"))
        run.finish(recover, recover)
        return Answer({"out": recover, "frames": n_frames}, [f"{counted(n_frames, 'frame')} in {recover}"])
    if recover is not None or not source or out is None:
        raise InputError("record: expected SOURCE and --out REC, or --recover REC, found neither or both")
    n_frames, n_dropped, has_scene = record_source(
        source, out, scene, codec=codec, seconds=seconds, fps=fps, stage=run.stage, force=force
    )
    run.finish(out, out, [*map(Path, source), scene])
    dropped = f", {n_dropped} dropped" if n_dropped else ""
    track = f"; next: softaim track {out} --out {out}-track" if has_scene else ""
    return Answer(
        {"out": out, "frames": n_frames, "dropped": n_dropped},
        [f"{counted(n_frames, 'frame')}{dropped} in {out}{track}"],
    )
