"""`softaim check`."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Force, Vector
from experiments.commands.run import Answer, Run


def check(
    run: Run,
    scene: Annotated[Path, typer.Argument(help="Scene file, or folder of a recording.")],
    out: Annotated[Path | None, typer.Option("--out", help="Folder for check.png and check.json.")] = None,
    fps: Annotated[
        float | None,
        typer.Option("--fps", min=0.1, max=1e5, help="Frame rate [frames/s]; default: the recording's, else 30."),
    ] = None,
    sd_mm: Annotated[
        float | None,
        typer.Option("--sd-mm", min=1e-6, max=1e3, help="Mark SD per axis [mm]; default: recording's or camera's."),
    ] = None,
    vector: Vector = None,
    force: Force = False,
) -> Answer:
    """Check a scene: rest shape, motion, best possible accuracy of the target, and missing steps."""
    run.only_with("--out", "--vector", "--force")
    from experiments.commands.console import lines_table
    from experiments.plots.check import check_figure
    from experiments.plots.style import write_picture
    from experiments.projects.check import checked
    from experiments.projects.report import check_lines, check_report

    with nullcontext() if out is None else run.folder(out, force=force, inputs=[scene]) as folder:
        done = checked(scene, frames_per_s=fps, sd_mm=sd_mm, advance=run.stage("check"))
        if folder is not None:
            write_picture(check_figure(done), folder / "check.png", vector)
        report, lines = check_report(done), check_lines(done)
        if folder is not None:
            (folder / "check.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    picture = [] if out is None else [f"Picture in {out / 'check.png'}"]
    return Answer({"out": out, **report}, [lines_table(lines), *picture])
