"""`softaim register`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Replace
from experiments.commands.run import Answer, Run


def register(
    run: Run,
    scene: Annotated[Path, typer.Argument(help="Scene file.")],
    points: Annotated[Path, typer.Option("--points", help="Points in the form of marks.csv, or a recording.")],
    out: Annotated[
        Path,
        typer.Option("--out", help="Scene file to write; a mesh is written into the same folder.", show_default=False),
    ],
    seconds: Annotated[
        float, typer.Option("--seconds", min=0.0, help="Points are averaged over this initial time [s].")
    ] = 1.0,
    force: Replace = False,
) -> Answer:
    """Register a scene's body rigidly to points measured on it, and report the error at the target."""
    from experiments.commands.console import registration_table
    from experiments.formats.outputs import check_new
    from experiments.formats.scene.scene import usable_scene
    from experiments.pipeline.register import registered, registration_lines, registration_report

    drawn, mesh = usable_scene(scene), out.with_suffix(".npz")
    check_new(out, force)
    if drawn.mesh is not None:
        check_new(mesh, force)
    run.use(drawn)
    done = registered(drawn, points, seconds, mesh)
    run.write_scene(done.scene, out, "register", recording=points, inputs=[scene], force=force)
    report = registration_report(done)
    line = f"Scene in {out}{f', its mesh in {mesh}' if drawn.mesh else ''}; next: softaim check {out}"
    return Answer({"out": out, **report}, [registration_table(report), *registration_lines(done), line])
