"""`softaim hue`."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Force, Fps
from experiments.commands.run import Answer, Run


def hue(
    run: Run,
    source: Annotated[str, typer.Argument(help="Film, folder of pictures, recording, or camera.")],
    at: Annotated[
        str | None, typer.Option("--at", help="Position U,V on a mark [px]; learns the mark's hue keys.")
    ] = None,
    frame: Annotated[int, typer.Option("--frame", min=0, help="With --at: number of the frame, from 0.")] = 0,
    fps: Fps = None,
    scene: Annotated[Path | None, typer.Option("--scene", help="Without --at: scene with the keys to test.")] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Without --at: folder for hue.csv and hue.png.")] = None,
    film: Annotated[
        bool, typer.Option("--film", help="With --out: also write film.avi with the selected pixels coloured.")
    ] = False,
    force: Force = False,
) -> Answer:
    """Learn a mark's hue from one position in a picture, or show which pixels a scene's hue keys select."""
    run.not_with("--at", "--scene", "--out", "--film", "--fps", "--force")
    run.only_with("--at", "--frame")
    run.only_with("--out", "--film", "--fps", "--force")
    if at is not None:
        return _learned(source, at, frame)
    return _taken(run, source, scene, out, film=film, fps=fps, force=force)


def _learned(source: str, at: str, frame: int) -> Answer:
    from experiments.pipeline.hue import hue_lines

    lines = hue_lines(source, at, frame)
    keys = {key: float(value) for key, _, value in (line.partition(" = ") for line in lines)}
    return Answer(keys, lines)


def _taken(
    run: Run, source: str, scene: Path | None, out: Path | None, *, film: bool, fps: float | None, force: bool
) -> Answer:
    from experiments.commands.console import sentence, taken_table
    from experiments.film.taken import taken_over, verdicts

    with nullcontext() if out is None else run.folder(out, force=force, inputs=[Path(source), scene]) as folder:
        done = taken_over(source, scene, folder, film=film, fps=fps)
    figures, words = done.figures(), verdicts(done)
    shown = [taken_table(figures, len(done.times_s)), *(sentence(one) for one in words)]
    if out is not None:
        shown.append(f"Table and pictures in {out}")
    return Answer({"out": out, "frames": len(done.times_s), "kinds": figures, "verdicts": words}, shown)
