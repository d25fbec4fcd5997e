"""`softaim live`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Force, Fps, SceneFile


def live(
    source: Annotated[
        str, typer.Option("--source", help="Camera index, device, film, folder, stream, recording, or phantom.")
    ],
    scene: SceneFile = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder to write to; default: live-DATE-TIME.")] = None,
    duration: Annotated[float | None, typer.Option("--duration", min=0.0, help="Stop after so many seconds.")] = None,
    fps: Fps = None,
    needle: Annotated[Path | None, typer.Option("--needle", help="A needle's file: give advice on it, too.")] = None,
    force: Force = False,
) -> None:
    """Follow the target in frames as they come, newest first, until Ctrl-C."""
    from experiments.pipeline.live import live as run

    run(source, scene, out, duration_s=duration, fps=fps, needle_path=needle, force=force)
