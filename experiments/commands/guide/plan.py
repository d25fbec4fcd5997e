"""`softaim plan`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Force, Out, Vector
from experiments.commands.run import Answer, Run


def plan(
    run: Run,
    source: Annotated[Path, typer.Argument(help="Folder of a recording, or a scene file for tissue at rest.")],
    out: Out,
    plan_file: Annotated[Path, typer.Option("--plan", help="Plan file: needle, skin and obstacles.")],
    vector: Vector = None,
    force: Force = False,
) -> Answer:
    """Rank straight needle paths by hit probability, considering the needle's push on the target."""
    from experiments.commands.console import plan_table
    from experiments.pipeline.plan import planned, report, write_plan
    from experiments.plots.plan import plan_figure
    from experiments.plots.style import write_picture

    with run.folder(out, force=force, inputs=[source, plan_file]) as folder:
        done = planned(source, plan_file, run.stage)
        run.use(done.scene, before="track")
        write_plan(done, folder)
        write_picture(plan_figure(done), folder / "plan.png", vector)
    figures = report(done)
    none = f"No path is allowed; reasons in {out / 'plan.csv'}"
    shown = none if figures["best"] is None else plan_table(figures)
    return Answer({"out": out, "plan": figures}, [shown, f"Table and picture in {out}"])
