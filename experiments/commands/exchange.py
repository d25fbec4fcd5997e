"""Subcommands for exchange with other programs: export of recordings, import of tables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Argument, Option

from experiments.commands.options import FASTEST_FPS, SLOWEST_FPS, Force, Out, RecordingFolder, Replace, SceneFile
from experiments.commands.run import Answer, Run
from experiments.errors import InputError, coordinates, shown
from experiments.plain import counted

ENDINGS = {"mcap": (".mcap",), "plus": (".igs.mha", ".seq.mha")}
"""File name extensions by format. The program PLUS uses .igs.mha; 3D Slicer uses .seq.mha."""


def export(
    run: Run,
    recording: RecordingFolder,
    to: Annotated[
        Literal["mcap", "plus"], Option(help="mcap: Foxglove, ROS 2; plus: PLUS, 3D Slicer.", show_default=False)
    ],
    out: Annotated[Path, Option(help="File to write: .mcap, .igs.mha or .seq.mha.", show_default=False)],
    estimates: Annotated[Path | None, Option(help="Output folder of `track` or `live`.")] = None,
    start: Annotated[
        str | None, Option(help="Time of the first frame, such as 2026-01-31T09:00:00Z; default: time 0 is 1970-01-01.")
    ] = None,
    scene: SceneFile = None,
    force: Replace = False,
) -> Answer:
    """Write a recording and its estimates for Foxglove and ROS 2, or for PLUS and 3D Slicer."""
    from experiments.formats.recording import read_recording
    from experiments.pipeline.exchange.exported import exported

    if not out.name.endswith(ENDINGS[to]):
        raise InputError.at("--out", f"a name that ends in {' or '.join(ENDINGS[to])}", shown(out.name))
    opened = exported(read_recording(recording, scene, run.stage("read")), estimates, start)
    found: dict[str, Any] = {"out": out, "frames": len(opened.recording.exposures_s)}
    with run.file(out, force=force, inputs=[recording, scene, estimates]) as file:
        run.use(opened.recording.scene)
        if to == "mcap":
            from experiments.pipeline.exchange.ros import export_mcap

            found["topics"] = export_mcap(opened, file, run.stage("export"))
            lines = [f"{topic}: {counted(n, 'message')}" for topic, n in found["topics"].items()]
        else:
            from experiments.pipeline.exchange.plus import export_plus, picture_off_mm

            found["placed"] = export_plus(opened, file, run.stage("export"))
            lines = [f"{counted(found['frames'], 'frame')}; {found['placed']} of them with the target"]
            if opened.recording.source is not None:
                off_mm = found["picture_off_mm"] = picture_off_mm(opened.recording.scene)
                lines.append(f"The pictures' affine map to the plane errs by up to {off_mm:.2f} mm at drawn marks")
    lines.append(f"Written to {out}")
    return Answer(found, lines)


def import_table(
    run: Run,
    table: Annotated[Path, Argument(help="CSV file of DeepLabCut, or analysis CSV file of SLEAP.")],
    scene: Annotated[Path, Option(help="Scene file that has the marks of the table.", show_default=False)],
    out: Out,
    fps: Annotated[
        float | None, Option(min=SLOWEST_FPS, max=FASTEST_FPS, help="Frame rate of the film [frames/s].")
    ] = None,
    frames: Annotated[Path | None, Option(help="Table frames.csv of exposure times; replaces --fps.")] = None,
    least: Annotated[float, Option(min=0.0, max=1.0, help="Least likelihood of the positions to use.")] = 0.6,
    sd_px: Annotated[float, Option(min=1e-3, max=1e3, help="Standard deviation of a position per axis [px].")] = 1.0,
    rename: Annotated[
        list[str] | None, Option(help="PART=NODE renames the body part PART to NODE; PART= omits it.")
    ] = None,
    mm_per_px: Annotated[
        float | None,
        Option(min=1e-6, max=1e3, help="Scale [mm/px] of a camera that faces the plane; replaces the scene's camera."),
    ] = None,
    origin_px: Annotated[str | None, Option(help="With --mm-per-px: pixel U,V at the plane's origin.")] = None,
    individual: Annotated[
        str | None, Option(help="With several animals: name of the animal (in SLEAP: track) to use.")
    ] = None,
    force: Force = False,
) -> Answer:
    """Convert positions from DeepLabCut or SLEAP into a recording. The scene's camera converts pixels to mm."""
    from experiments.pipeline.exchange.marks import import_table as imported
    from experiments.pipeline.exchange.marks import plane_scale, write_imported

    times = fps if frames is None else frames
    if times is None or (fps is not None and frames is not None):
        raise InputError("import: expected --fps or --frames, found " + ("neither" if times is None else "both"))
    if (mm_per_px is None) != (origin_px is None):
        raise InputError("import: expected --mm-per-px and --origin-px, found one of them")
    scale = None
    if mm_per_px is not None and origin_px is not None:
        u, v = coordinates("--origin-px", origin_px, 2, "U,V: a position [px]")
        scale = plane_scale(mm_per_px, (u, v))
    with run.folder(out, force=force, inputs=[table, scene, frames]) as folder:
        done = imported(
            table, scene, times, least=least, sd_px=sd_px, renamed=rename or [], scale=scale, individual=individual
        )
        run.use(done.scene)
        write_imported(done, folder)
    counts = done.counts()
    seen = ", ".join(f"{node} {n}" for node, n in counts.items())
    lines = [
        f"{counted(len(done.exposures_s), 'frame')}; seen in: {seen}",
        f"Positions omitted: {done.unlikely} with likelihood below {least:g}, {done.outside} outside the picture",
        *([f"Positions set manually, used without a likelihood: {done.manual}"] if done.manual else []),
        f"Recording in {out}; next: softaim identify if it shows the target, else tune and track",
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
