"""`softaim export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from experiments.commands.options import RecordingFolder, Replace, SceneFile
from experiments.commands.run import Answer, Run
from experiments.errors import InputError, shown
from experiments.plain import counted

ENDINGS = {"mcap": (".mcap",), "plus": (".igs.mha", ".seq.mha")}
"""File name extensions by format; of the two for `plus`, PLUS uses the first and 3D Slicer the second."""


def export(
    run: Run,
    recording: RecordingFolder,
    to: Annotated[
        Literal["mcap", "plus"],
        typer.Option("--to", help="mcap: Foxglove, ROS 2; plus: PLUS, 3D Slicer.", show_default=False),
    ],
    out: Annotated[Path, typer.Option("--out", help="File to write: .mcap, .igs.mha or .seq.mha.", show_default=False)],
    estimates: Annotated[Path | None, typer.Option("--estimates", help="Output folder of `track` or `live`.")] = None,
    start: Annotated[
        str | None,
        typer.Option(
            "--start",
            help="Time of the first frame, such as 2026-01-31T09:00:00Z; default: recorded time since 1970.",
        ),
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
