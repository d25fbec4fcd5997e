"""`softaim import`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Force, Out
from experiments.commands.run import Answer, Run
from experiments.errors import InputError, coordinates
from experiments.plain import counted


def import_table(
    run: Run,
    table: Annotated[Path, typer.Argument(help="CSV file of DeepLabCut, or analysis CSV file of SLEAP.")],
    scene: Annotated[Path, typer.Option("--scene", help="Scene file with the table's marks.", show_default=False)],
    out: Out,
    fps: Annotated[
        float | None, typer.Option("--fps", min=0.001, max=1e5, help="Frame rate of the film [frames/s].")
    ] = None,
    frames: Annotated[
        Path | None, typer.Option("--frames", help="Table frames.csv of exposure times; replaces --fps.")
    ] = None,
    least: Annotated[
        float, typer.Option("--least", min=0.0, max=1.0, help="Positions with a lower likelihood are omitted.")
    ] = 0.6,
    sd_px: Annotated[
        float,
        typer.Option("--sd-px", min=1e-3, max=1e3, help="Standard deviation of a position per axis [px]."),
    ] = 1.0,
    rename: Annotated[
        list[str] | None,
        typer.Option("--rename", help="PART=NODE renames the body part PART to NODE; PART= omits it."),
    ] = None,
    mm_per_px: Annotated[
        float | None,
        typer.Option(
            "--mm-per-px",
            min=1e-6,
            max=1e3,
            help="Scale [mm/px] of a camera that faces the plane; replaces the scene's camera.",
        ),
    ] = None,
    origin_px: Annotated[
        str | None, typer.Option("--origin-px", help="With --mm-per-px: pixel U,V at the plane's origin.")
    ] = None,
    individual: Annotated[
        str | None,
        typer.Option("--individual", help="With several animals: name of the animal (in SLEAP: track) to use."),
    ] = None,
    force: Force = False,
) -> Answer:
    """Convert positions of DeepLabCut or SLEAP into a recording, with the scene's camera."""
    from experiments.pipeline.exchange.marks import ImportSettings, plane_scale, write_imported
    from experiments.pipeline.exchange.marks import import_table as imported

    times = fps if frames is None else frames
    if times is None or (fps is not None and frames is not None):
        raise InputError("import: expected --fps or --frames, found " + ("neither" if times is None else "both"))
    if (mm_per_px is None) != (origin_px is None):
        raise InputError("import: expected --mm-per-px and --origin-px, found one of them")
    scale = None
    if mm_per_px is not None and origin_px is not None:
        u, v = coordinates("--origin-px", origin_px, 2, "U,V: a position [px]")
        scale = plane_scale(mm_per_px, (u, v))
    settings = ImportSettings(least, sd_px)
    with run.folder(out, force=force, inputs=[table, scene, frames]) as folder:
        done = imported(
            table, scene, times, settings=settings, renamed=rename or [], scale=scale, individual=individual
        )
        run.use(done.scene)
        write_imported(done, folder)
    counts = done.counts()
    seen = ", ".join(f"{node} {n}" for node, n in counts.items())
    lines = [
        f"{counted(len(done.exposures_s), 'frame')}; seen in: {seen}",
        f"Positions omitted: {done.unlikely} with likelihood below {least:g}, {done.outside} outside the picture",
        *([f"Positions set manually, used without a likelihood: {done.manual}"] if done.manual else []),
        f"Recording in {out}; next: softaim identify if it shows the target, else softaim track",
    ]
    report = {
        "frames": len(done.exposures_s),
        "marks": counts,
        "unlikely": done.unlikely,
        "outside": done.outside,
        "manual": done.manual,
    }
    return Answer({"out": out, **report}, lines)


import_table.__name__ = "import"  # a keyword of Python cannot name a function
