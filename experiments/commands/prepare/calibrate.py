"""`softaim calibrate`."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Force, Vector
from experiments.commands.run import Answer, Run


def calibrate(
    run: Run,
    board: Annotated[str, typer.Option("--board", help="Inner corners per side (ChArUco: squares), such as 9x6.")],
    square_mm: Annotated[float, typer.Option("--square-mm", help="Side of a square [mm].")],
    out: Annotated[Path, typer.Option("--out", help="Camera file to write; for several cameras, a folder.")],
    pictures: Annotated[list[Path] | None, typer.Argument(help="Pictures, a picture folder, or a film.")] = None,
    camera: Annotated[
        list[str] | None, typer.Option("--camera", help="Name and picture folder of a camera, NAME=FOLDER; repeat.")
    ] = None,
    charuco: Annotated[str | None, typer.Option("--charuco", help="ChArUco marker dictionary, such as 4X4_50.")] = None,
    marker_mm: Annotated[float | None, typer.Option("--marker-mm", help="Side of a ChArUco marker [mm].")] = None,
    plane: Annotated[
        Path | None, typer.Option("--plane", help="Picture of the board in the plane of the marks.")
    ] = None,
    opencv_yaml: Annotated[Path | None, typer.Option("--opencv-yaml", help="Lens file to write for OpenCV.")] = None,
    ros_yaml: Annotated[Path | None, typer.Option("--ros-yaml", help="Lens file to write for ROS.")] = None,
    vector: Vector = None,
    force: Force = False,
) -> Answer:
    """Estimate lens and pose of cameras, with their uncertainty, from pictures of a board."""
    from experiments.commands.console import calibration_lines, calibration_table
    from experiments.formats.camera_file import camera_text
    from experiments.pipeline.calibrate import board_of
    from experiments.pipeline.calibrate import command as calibrated
    from experiments.plots.calibration import calibration_picture

    printed = board_of(board, square_mm, charuco, marker_mm)
    read = [*(pictures or []), *(Path(text.partition("=")[2]) for text in camera or []), plane]
    done = calibrated(
        pictures or [],
        camera or [],
        printed,
        out,
        plane=plane,
        opencv_yaml=opencv_yaml,
        ros_yaml=ros_yaml,
        vector=vector,
        picture=calibration_picture,
        force=force,
        stage=run.stage,
        write=lambda files: run.write_files(files, read),
        folder=lambda path: run.folder(path, force=force, inputs=read),
    )
    shown = [line for one in done for line in (calibration_table(one), *calibration_lines(one))]
    line = f"Camera in {out}; a picture of the residuals beside it" if pictures else f"Cameras and pictures in {out}"
    return Answer({"out": out, "cameras": [tomllib.loads(camera_text(one)) for one in done]}, [*shown, line])
