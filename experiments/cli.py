"""The command `softaim`. What a subcommand needs is imported when it runs, so that help is instant."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    name="softaim",
    help="Where a hidden target in moving soft tissue is, and how sure of it one may be.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

Out = Annotated[Path, typer.Option("--out", help="Folder to write to; made if missing.", show_default=False)]
Force = Annotated[bool, typer.Option("--force", help="Write into a folder that is not empty.")]
Fps = Annotated[float | None, typer.Option("--fps", min=0.001, help="Of a folder of pictures: how many a second.")]
SceneFile = Annotated[Path | None, typer.Option("--scene", help="Scene file in place of the recording's own.")]


@app.command()
def simulate(
    scenario: Annotated[str, typer.Argument(help="quiet, poked, paper-camera, or a scenario file.")],
    out: Out,
    force: Force = False,
) -> None:
    """Move and film a scenario: write a recording with its truth."""
    from experiments.scenario import read_scenario
    from experiments.simulate import simulate as write_recording

    read = read_scenario(scenario)
    with progress() as stage:
        write_recording(read, out, force=force, advance=stage("film"))
    print(f"Recording in {out}; next: softaim track {out} --out {out}-track")


@app.command()
def track(
    recording: Annotated[Path, typer.Argument(help="Folder of the recording.")],
    out: Out,
    scene: SceneFile = None,
    check: Annotated[bool, typer.Option("--check", help="Predict each mark as if hidden; widen if wrong.")] = False,
    force: Force = False,
) -> None:
    """Follow the hidden target through a recording: the paper's method and ours, tables and plots."""
    from experiments.outputs import output_folder
    from experiments.plots import write_plots
    from experiments.recording import open_recording
    from experiments.track import summary, write_tables
    from experiments.track import track as run

    opened = open_recording(recording, scene)
    with output_folder(out, force=force, inputs=[recording]) as folder, progress() as stage:
        done = run(opened, stage("track"), check=check)
        write_tables(done, folder)
        write_plots(done, folder)
    from experiments.events import tell_swap
    from experiments.tell import track_table

    for step in done.steps:
        if step.swap is not None:
            tell_swap(step.swap)
    print_table(track_table(summary(done)))
    if check:
        nees, scale = done.counts["check_nees"], done.counts["check_scale"]
        print(f"Marks predicted as if hidden: NEES {nees:.2f}; the target's covariance times {scale:.2f}")
    print(f"Tables and pictures in {out}")


@app.command()
def compare(
    recording: Annotated[Path, typer.Argument(help="Folder of the recording.")],
    out: Out,
    scene: SceneFile = None,
    methods: Annotated[str | None, typer.Option("--methods", help="Which, separated by commas; default: all.")] = None,
    force: Force = False,
) -> None:
    """Follow the target by the paper's method, ours and textbook filters, on the same marks."""
    from experiments.compare import METHODS, chosen, summary, write_comparison
    from experiments.compare import compare as run
    from experiments.outputs import output_folder
    from experiments.recording import open_recording
    from experiments.tell import track_table

    named = METHODS if methods is None else chosen(methods)
    opened = open_recording(recording, scene)
    with output_folder(out, force=force, inputs=[recording]) as folder, progress() as stage:
        done = run(opened, named, stage)
        write_comparison(done, folder)
    print_table(track_table(summary(done)))
    print(f"Tables and a picture in {out}")


@app.command()
def calibrate(
    board: Annotated[str, typer.Option("--board", help="Inner corners, 9x6; squares of a ChArUco board.")],
    square_mm: Annotated[float, typer.Option("--square-mm", help="Side of a square.")],
    out: Annotated[Path, typer.Option("--out", help="camera.toml; a folder for several cameras.")],
    pictures: Annotated[list[Path] | None, typer.Argument(help="Pictures, a folder of them, or a film.")] = None,
    camera: Annotated[list[str] | None, typer.Option("--camera", help="NAME=FOLDER, once a camera.")] = None,
    charuco: Annotated[str | None, typer.Option("--charuco", help="Dictionary of the markers, 4X4_50.")] = None,
    marker_mm: Annotated[float | None, typer.Option("--marker-mm", help="Side of a marker.")] = None,
    plane: Annotated[Path | None, typer.Option("--plane", help="Picture of the board on the phantom's plane.")] = None,
    opencv_yaml: Annotated[Path | None, typer.Option("--opencv-yaml", help="Write the lens for OpenCV, too.")] = None,
    ros_yaml: Annotated[Path | None, typer.Option("--ros-yaml", help="Write the lens for ROS, too.")] = None,
    force: Force = False,
) -> None:
    """Find lens and place of cameras from pictures of a board, and how well they are known."""
    from experiments.calibrate import AlsoWrite, board_of
    from experiments.calibrate import command as run
    from experiments.tell import calibration_lines, calibration_table

    printed = board_of(board, square_mm, charuco, marker_mm)
    also = AlsoWrite(opencv_yaml, ros_yaml)
    with progress() as stage:
        done = run(pictures or [], camera or [], printed, out, plane=plane, also=also, force=force, stage=stage)
    for one in done:
        print_table(calibration_table(one))
        print(*calibration_lines(one), sep="\n")
    print(f"Camera in {out}; a picture of the residuals beside it" if pictures else f"Cameras and pictures in {out}")


@app.command()
def advise(
    recording: Annotated[Path, typer.Argument(help="Folder of the recording.")],
    needle: Annotated[Path, typer.Option("--needle", help="The needle's file.", show_default=False)],
    out: Out,
    scene: SceneFile = None,
    force: Force = False,
) -> None:
    """Say for each frame whether a needle should go in, wait or turn: a table and a picture."""
    from experiments.advise import advise as run
    from experiments.advise import write_advice
    from experiments.needle_file import read_needle
    from experiments.outputs import output_folder
    from experiments.recording import open_recording
    from experiments.tell import advice_line

    opened = open_recording(recording, scene)
    plan = read_needle(needle, opened.scene.target.radius_m, opened.scene.network.dim)
    with output_folder(out, force=force, inputs=[recording]) as folder, progress() as stage:
        done = run(opened, plan, stage("advise"))
        write_advice(done, folder)
    print(advice_line(done.counts()))
    print(f"Table and picture in {out}")


SceneOut = Annotated[Path, typer.Option("--out", help="Scene file to write.", show_default=False)]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for programs.")]


@app.command()
def identify(
    recording: Annotated[Path, typer.Argument(help="Calibration recording in which the hidden mark is seen, too.")],
    out: SceneOut,
    scene: SceneFile = None,
    at_rest: Annotated[
        bool, typer.Option("--at-rest", help="The tissue rests: correct its rest lengths only.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Find the tissue's constants: write a scene to track with, say how well each is known."""
    from experiments.identify import identification_report, identified_scene, marks_in, resting_scene
    from experiments.recording import open_recording
    from experiments.scene import write_scene
    from experiments.tell import constants_table

    opened = open_recording(recording, scene)
    with progress() as stage:
        frames = marks_in(opened, stage("marks"))
        if at_rest:
            write_scene(resting_scene(opened, frames), out)
        else:
            found_scene, found = identified_scene(opened, frames, stage("identify"))
            write_scene(found_scene, out)
    if at_rest:
        print(f"Scene in {out}: it rests where the recording shows it")
    elif as_json:
        print(json.dumps(identification_report(found), indent=2))
    else:
        print_table(constants_table(identification_report(found)))
        print(f"Scene in {out}; next: softaim track REC --scene {out} --out DIR")


@app.command()
def tune(
    recording: Annotated[Path, typer.Argument(help="Folder of the recording.")],
    out: SceneOut,
    scene: SceneFile = None,
    as_json: AsJson = False,
) -> None:
    """Find the noise levels under which a recording is most probable; no truth is needed. Write a scene with them."""
    from experiments.identify import marks_in, tuned_scene, tuning_report
    from experiments.recording import open_recording
    from experiments.scene import write_scene
    from experiments.tell import levels_table

    opened = open_recording(recording, scene)
    with progress() as stage:
        frames = marks_in(opened, stage("marks"))
        found_scene, found = tuned_scene(opened, frames, stage("tune"))
        write_scene(found_scene, out)
    if as_json:
        print(json.dumps(tuning_report(found), indent=2))
    else:
        print_table(levels_table(tuning_report(found)))
        print(f"Scene in {out}; next: softaim track REC --scene {out} --out DIR")


@app.command()
def plan(
    source: Annotated[Path, typer.Argument(help="Folder of a recording, or a scene file: the tissue at rest.")],
    out: Out,
    plan_file: Annotated[Path, typer.Option("--plan", help="The needle, the skin, what is in the way: plan.toml.")],
    force: Force = False,
) -> None:
    """Rank straight needle paths by the probability of a hit, the push of the needle foreseen."""
    from experiments.outputs import output_folder
    from experiments.plan import planned, report, write_plan
    from experiments.tell import plan_table

    inputs = [source] if source.is_dir() else []
    with output_folder(out, force=force, inputs=inputs) as folder, progress() as stage:
        done = planned(source, plan_file, stage("plan"))
        write_plan(done, folder)
    told = report(done)
    if told["best"] is None:
        print(f"No path is allowed; why: {out / 'plan.csv'}")
    else:
        print_table(plan_table(told))
    print(f"Table and picture in {out}")


@app.command()
def insert(
    scenario: Annotated[str, typer.Argument(help="quiet, poked, shoved, breathing, or a scenario file.")],
    out: Out,
    runs: Annotated[int, typer.Option("--runs", min=1, help="Worlds in which every policy is tried.")] = 2000,
    speed_mm_s: Annotated[float, typer.Option("--speed-mm-s", min=10.0, max=1000.0, help="Of the needle.")] = 50.0,
    radius_mm: Annotated[float, typer.Option("--radius-mm", help="Of the lesion.")] = 5.0,
    strength: Annotated[float, typer.Option("--strength", min=0.01, help="Factor on pokes and breathing.")] = 1.0,
    force: Force = False,
) -> None:
    """Drive a simulated needle into moving tissue by five policies: hit rates, misses, whether odds came true."""
    from experiments.insert import case_of, summary, write_insertions
    from experiments.insert import insert as run
    from experiments.outputs import output_folder
    from experiments.scenario import read_scenario
    from experiments.tell import insertion_table

    case = case_of(read_scenario(scenario), speed_m_s=1e-3 * speed_mm_s, strength=strength)
    with output_folder(out, force=force) as folder, progress() as stage:
        done = run(case, runs, 1e-3 * radius_mm, stage("insert"))
        write_insertions(done, folder)
    told = summary(done)
    print_table(insertion_table(told))
    print(f"Tables and pictures in {out}")


@app.command()
def demo(out: Out = Path("demo"), force: Force = False) -> None:
    """Simulate, film and track the paper's two scenarios, and compare with what the paper found."""
    from experiments.demo import demo as run
    from experiments.tell import demo_table

    with progress() as stage:
        figures = run(out, force=force, stage=stage)
    print_table(demo_table(figures))
    for scenario in figures:
        print(f"Pictures: {out / scenario / 'path.png'}, error.png, sigma.png, consistency.png beside it")


@app.command()
def live(
    source: Annotated[
        str, typer.Option("--source", help="Camera index, device, film, folder, stream, recording, or phantom.")
    ],
    scene: SceneFile = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder to write to; default: live-DATE-TIME.")] = None,
    duration: Annotated[float | None, typer.Option("--duration", min=0.0, help="Stop after so many seconds.")] = None,
    fps: Fps = None,
    needle: Annotated[Path | None, typer.Option("--needle", help="A needle's file: give advice on it, too.")] = None,
    force: Force = False,
) -> None:
    """Follow the target in frames as they come, newest first, until Ctrl-C."""
    from experiments.live import live as run

    run(source, scene, out, duration_s=duration, fps=fps, needle_path=needle, force=force)


@app.command()
def record(
    source: Annotated[
        str | None, typer.Argument(help="Camera index, device, film, folder, stream, recording, or phantom.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder of the recording; new or empty.")] = None,
    scene: Annotated[Path | None, typer.Option("--scene", help="Scene file to copy into it.")] = None,
    codec: Annotated[str, typer.Option("--codec", help="FFV1 loses nothing; MJPG is small.")] = "FFV1",
    seconds: Annotated[float | None, typer.Option("--seconds", min=0.0, help="Stop after so many seconds.")] = None,
    fps: Fps = None,
    recover: Annotated[
        Path | None, typer.Option("--recover", help="Join what a recording that was killed has left, in place.")
    ] = None,
) -> None:
    """Write frames and their times as they come, until Ctrl-C: a recording, whole up to the last second if killed."""
    from experiments.errors import InputError
    from experiments.recorder import join, record_source

    if (recover is None) == (source is None) or (recover is None) == (out is None):
        raise InputError("record: expected SOURCE and --out REC, or --recover REC, found neither or both")
    if recover is not None:
        with progress() as stage:
            n_frames = join(recover, stage("join"))
        print(f"{n_frames} frames in {recover}")
    elif source is not None and out is not None:
        with progress() as stage:
            print(record_source(source, out, scene, codec=codec, seconds=seconds, fps=fps, stage=stage))


@app.command()
def hue(
    source: Annotated[str, typer.Argument(help="Film, folder of pictures, recording, or camera.")],
    at: Annotated[str, typer.Option("--at", help="U,V: a place on a mark [px].", show_default=False)],
    frame: Annotated[int, typer.Option("--frame", min=0, help="Which frame, counted from 0.")] = 0,
    fps: Fps = None,
) -> None:
    """Learn the hue of a kind of mark from one place in a picture: the keys for its table in scene.toml."""
    from experiments.hue import hue_lines

    print(*hue_lines(source, at, frame, fps), sep="\n")


@app.command()
def bench(
    as_json: AsJson = False,
) -> None:
    """Time the filter and the loop against their references, in one run."""
    from experiments.bench import bench as run
    from experiments.tell import bench_table

    with progress() as stage:
        report = run(stage("bench"))
    if as_json:
        print(json.dumps(report, indent=2))
    else:
        print_table(bench_table(report))


@contextmanager
def progress() -> Iterator[Callable[[str], Callable[[float], None]]]:
    """A progress bar on standard error: stage(name) gives what is to be told the share done."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description:<16}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    with Progress(*columns, TimeRemainingColumn(), console=console, disable=not console.is_terminal) as bar:

        def stage(name: str) -> Callable[[float], None]:
            task = bar.add_task(name, total=1.0)
            return lambda share: bar.update(task, completed=share)

        yield stage


def print_table(table: object) -> None:
    """Print a rich table to standard output."""
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else 110).print(table)


def main() -> None:
    """Run the command; bad input is one line on standard error and exit code 2."""
    try:
        app()
    except Exception as fault:
        if not is_bad_input(fault):
            raise
        print(f"softaim: {fault}", file=sys.stderr)
        sys.exit(2)


def is_bad_input(fault: Exception) -> bool:
    """Whether what was given is at fault and not the program."""
    from dynamics import NetworkError
    from experiments.errors import InputError
    from vision import CalibrationError, HueError, SourceError

    return isinstance(fault, InputError | NetworkError | SourceError | HueError | CalibrationError)
