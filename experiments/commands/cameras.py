"""Subcommands for cameras: calibration, recordings, hues of marks."""

from __future__ import annotations

import tomllib
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from experiments.commands.options import LEAST_MM, MOST_MM, Force, Fps, Vector
from experiments.commands.run import Answer, Run
from experiments.errors import InputError, coordinates, placed
from experiments.plain import counted


def calibrate(
    run: Run,
    board: Annotated[str, Option(help="Number of inner corners (ChArUco: squares) along both sides, such as 9x6.")],
    square_mm: Annotated[float, Option(min=LEAST_MM, max=MOST_MM, help="Side of a square [mm].")],
    out: Annotated[Path, Option(help="Camera file to write; for several cameras, a folder.")],
    pictures: Annotated[list[Path] | None, Argument(help="Pictures, a picture folder, or a film.")] = None,
    camera: Annotated[
        list[str] | None, Option(help="NAME=FOLDER: a camera and its picture folder; repeat for each camera.")
    ] = None,
    charuco: Annotated[str | None, Option(help="ChArUco marker dictionary, such as 4X4_50.")] = None,
    marker_mm: Annotated[float | None, Option(min=LEAST_MM, max=MOST_MM, help="Side of a ChArUco marker [mm].")] = None,
    plane: Annotated[Path | None, Option(help="Picture of the board in the plane of the marks; default: last.")] = None,
    opencv_yaml: Annotated[Path | None, Option(help="Lens file to write for OpenCV.")] = None,
    ros_yaml: Annotated[Path | None, Option(help="Lens file to write for ROS.")] = None,
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


def record(
    run: Run,
    source: Annotated[
        list[str] | None,
        Argument(
            help="Camera index, device, film, folder, stream, recording or phantom; for several cameras: NAME=SOURCE "
            "for each."
        ),
    ] = None,
    out: Annotated[Path | None, Option(help="Folder of the recording; new or empty.")] = None,
    scene: Annotated[Path | None, Option(help="Scene file to copy into the recording.")] = None,
    codec: Annotated[str, Option(help="FFV1: lossless; MJPG: smaller files.")] = "FFV1",
    seconds: Annotated[float | None, Option(min=0.0, help="Stop after this time [s].")] = None,
    fps: Fps = None,
    recover: Annotated[Path | None, Option(help="Folder of a killed recording; joins its pieces to a film.")] = None,
    force: Force = False,
) -> Answer:
    """Record frames and their times until Ctrl-C; a killed recording loses at most its last second."""
    run.not_with("--recover", "--scene", "--codec", "--seconds", "--fps", "--force")
    from experiments.pipeline.recorder import join, record_source

    if recover is not None and not source and out is None:
        n_frames = join(recover, run.stage("join"))
        run.finish(recover, recover)
        return Answer({"out": recover, "frames": n_frames}, [f"{counted(n_frames, 'frame')} in {recover}"])
    if recover is not None or not source or out is None:
        raise InputError("record: expected SOURCE and --out REC, or --recover REC, found neither or both")
    n_frames, n_dropped, has_scene = record_source(
        source, out, scene, codec=codec, seconds=seconds, fps=fps, stage=run.stage, force=force
    )
    run.finish(out, out, [*map(Path, source), scene])
    dropped = f", {n_dropped} dropped" if n_dropped else ""
    track = f"; next: softaim track {out} --out {out}-track" if has_scene else ""
    return Answer(
        {"out": out, "frames": n_frames, "dropped": n_dropped},
        [f"{counted(n_frames, 'frame')}{dropped} in {out}{track}"],
    )


def hue(
    run: Run,
    source: Annotated[str, Argument(help="Film, folder of pictures, recording, or camera.")],
    at: Annotated[str | None, Option(help="Print the hue keys of the mark at this position U,V [px].")] = None,
    frame: Annotated[int, Option(min=0, help="With --at: number of the frame, from 0.")] = 0,
    fps: Fps = None,
    scene: Annotated[Path | None, Option(help="Without --at: scene whose hue keys select the pixels.")] = None,
    out: Annotated[Path | None, Option(help="Without --at: folder for hue.csv and hue.png.")] = None,
    film: Annotated[
        bool, Option("--film", help="With --out: also write film.avi with the selected pixels coloured.")
    ] = False,
    force: Force = False,
) -> Answer:
    """Learn a mark's hue from one position in a picture, or show which pixels a scene's hue keys select."""
    run.not_with("--at", "--scene", "--out", "--film", "--fps", "--force")
    run.only_with("--at", "--frame")
    run.only_with("--out", "--film", "--fps", "--force")
    if at is not None:
        return learned_hue(source, at, frame)
    return _taken(run, source, scene, out, film=film, fps=fps, force=force)


DIGITS = {"hue_deg": 1, "half_width_deg": 1, "min_saturation": 3, "min_value": 3}
"""Decimals of a mark's hue keys."""


def learned_hue(source: str, at: str, number: int) -> Answer:
    """The hue keys of the mark at the pixel "u,v" of a frame; raises InputError if there is no mark."""
    from experiments.pipeline.frame_sources import open_source
    from vision import NOMINAL_FPS, HueError, LiveFrames, SourceError, learn_hue, shown_source

    u, v = coordinates("--at", at, 2, "two numbers, U,V")
    _, frames = open_source(source, None, live=False, usual_fps=NOMINAL_FPS)
    named = shown_source(source)
    with frames, placed(named if isinstance(frames, LiveFrames) else "", SourceError):
        frame = next((frame for frame in frames if frame.index == number), None)
    if frame is None:
        raise InputError(f"{named}: expected a frame {number}, found fewer")
    with placed(f"{named}: frame {number}", HueError, ValueError):
        hue = learn_hue(frame.image, (u, v))
    keys = {key: f"{getattr(hue, key):.{digits}f}" for key, digits in DIGITS.items()}
    return Answer({key: float(text) for key, text in keys.items()}, [f"{key} = {text}" for key, text in keys.items()])


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
