"""`softaim hue`."""

from __future__ import annotations

from typing import Annotated

import typer

from experiments.commands.options import Fps


def hue(
    source: Annotated[str, typer.Argument(help="Film, folder of pictures, recording, or camera.")],
    at: Annotated[str, typer.Option("--at", help="U,V: a place on a mark [px].", show_default=False)],
    frame: Annotated[int, typer.Option("--frame", min=0, help="Which frame, counted from 0.")] = 0,
    fps: Fps = None,
) -> None:
    """Learn the hue of a kind of mark from one place in a picture: the keys for its table in scene.toml."""
    from experiments.pipeline.hue import hue_lines

    print(*hue_lines(source, at, frame, fps), sep="\n")
