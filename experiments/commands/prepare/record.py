"""`softaim record`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Fps
from experiments.commands.terminal import progress


def record(
    source: Annotated[
        str | None, typer.Argument(help="Camera index, device, film, folder, stream, recording, or phantom.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder of the recording; new or empty.")] = None,
    scene: Annotated[Path | None, typer.Option("--scene", help="Scene file to copy into it.")] = None,
    codec: Annotated[str, typer.Option("--codec", help="FFV1 loses nothing; MJPG is small.")] = "FFV1",
    seconds: Annotated[float | None, typer.Option("--seconds", min=0.0, help="Stop after so many seconds.")] = None,
    fps: Fps = None,
    recover: Annotated[
        Path | None, typer.Option("--recover", help="Join what a recording that was killed has left, in place.")
    ] = None,
) -> None:
    """Write frames and their times as they come, until Ctrl-C: a recording, whole up to the last second if killed."""
    from experiments.errors import InputError
    from experiments.pipeline.recorder import join, record_source

    if (recover is None) == (source is None) or (recover is None) == (out is None):
        raise InputError("record: expected SOURCE and --out REC, or --recover REC, found neither or both")
    if recover is not None:
        with progress() as stage:
            n_frames = join(recover, stage("join"))
        print(f"{n_frames} frames in {recover}")
    elif source is not None and out is not None:
        with progress() as stage:
            print(record_source(source, out, scene, codec=codec, seconds=seconds, fps=fps, stage=stage))
