"""`softaim hue`."""

from __future__ import annotations

from typing import Annotated

import typer

from experiments.commands.options import Fps
from experiments.commands.run import Answer, Run


def hue(
    run: Run,
    source: Annotated[str, typer.Argument(help="Film, folder of pictures, recording, or camera.")],
    at: Annotated[str, typer.Option("--at", help="U,V: a place on a mark [px].", show_default=False)],
    frame: Annotated[int, typer.Option("--frame", min=0, help="Which frame, counted from 0.")] = 0,
    fps: Fps = None,
) -> Answer:
    """Learn the hue of a kind of mark from one place in a picture: the keys for its table in scene.toml."""
    from experiments.pipeline.hue import hue_lines

    lines = hue_lines(source, at, frame, fps)
    keys = {key: float(value) for key, _, value in (line.partition(" = ") for line in lines)}
    return Answer(keys, lambda: print(*lines, sep="\n"))
