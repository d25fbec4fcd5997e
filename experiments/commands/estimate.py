"""Subcommands that estimate the target, or the constants and noise levels of the model."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from experiments.commands.options import (
    Force,
    Fps,
    Minutes,
    Out,
    RecordingFolder,
    Replace,
    SceneFile,
    SceneOut,
    Vector,
    WithFilm,
)
from experiments.commands.run import Answer, Run
from experiments.errors import InputError
from experiments.plain import counted

if TYPE_CHECKING:
    from experiments.formats.needle_file import NeedlePlan
    from experiments.formats.scene.scene import Scene
    from experiments.pipeline.live.following import Attendant


def track(
    run: Run,
    recording: RecordingFolder,
    out: Out,
    scene: SceneFile = None,
    check: Annotated[
        bool,
        Option(
            "--check",
            help="Predict each mark from the other marks; if errors are too large, enlarge the target's covariance.",
        ),
    ] = False,
    film: WithFilm = False,
    vector: Vector = None,
    force: Force = False,
) -> Answer:
    """Track the hidden target in a recording with the paper's method and Softaim's filter; write tables and plots."""
    from experiments.commands.console import fit_lines, marks_table, sentence, track_table, withheld_table
    from experiments.film.film import Film
    from experiments.formats.recording import read_recording
    from experiments.pipeline.events import report_move, report_swap
    from experiments.pipeline.line import FILTER
    from experiments.pipeline.scores.fit import withheld_words
    from experiments.pipeline.track import summary, write_tables
    from experiments.pipeline.track import track as tracked
    from experiments.plots.track import write_track_plots

    opened = read_recording(recording, scene, run.stage("read"))
    with run.folder(out, force=force, inputs=[recording, scene]) as folder:
        run.use(opened.scene, before="track")
        with Film(folder, opened) if film else nullcontext() as watch:
            done = tracked(opened, run.stage("track"), check=check, watch=watch)
        write_tables(done, folder)
        write_track_plots(done, folder, vector, advance=run.stage("pictures"))
        for step in done.steps:
            if step.swap is not None:
                report_swap(step.swap)
            for camera, moved in step.reference.moves.items() if step.reference is not None else ():
                report_move(moved, camera)
    figures = summary(done)
    ours = figures[FILTER]
    shown = [track_table(figures), *fit_lines(ours)]
    if any(one.found < 1.0 for one in done.marks.values()):
        shown.append(marks_table(ours))
    if ours.get("marks_verdict"):
        shown.append(sentence(ours["marks_verdict"]))
    if check and done.withheld:
        shown.append(withheld_table(ours))
    if check:
        shown.append(sentence(withheld_words(done.withheld, float(done.counts["check_scale"] or 1.0))))
    return Answer({"out": out, "summary": figures}, [*shown, f"Tables and pictures in {out}"])


def smooth(
    run: Run, recording: RecordingFolder, out: Out, scene: SceneFile = None, vector: Vector = None, force: Force = False
) -> Answer:
    """Estimate the target at each frame from the marks of all frames, including later ones."""
    from experiments.commands.console import track_table
    from experiments.formats.recording import read_recording
    from experiments.pipeline.compare import SMOOTHER, compare, summary, write_smoothed
    from experiments.plots.compare import comparison_figure
    from experiments.plots.style import write_picture

    opened = read_recording(recording, scene, run.stage("read"))
    with run.folder(out, force=force, inputs=[recording, scene]) as folder:
        run.use(opened.scene, before="track")
        done = compare(opened, [SMOOTHER], run.stage)
        write_smoothed(done, folder)
        write_picture(comparison_figure(done), folder / "compare.png", vector)
    figures = summary(done)
    line = f"Tables and a picture in {out}; estimates.csv has the smoother's estimates"
    return Answer({"out": out, "summary": figures}, [track_table(figures), line])


def replay(run: Run, recording: RecordingFolder, out: Out, force: Force = False) -> Answer:
    """Repeat a run recorded by `softaim live --record`, and compare the results bit for bit."""
    from experiments.formats.scene.scene import read_scene
    from experiments.pipeline.live.replaying import replay as replayed

    with run.folder(out, force=force, inputs=[recording]) as folder:
        run.use(read_scene(recording / "scene.toml"))
        done = replayed(recording, folder, run.stage("replay"))
    fault = None
    if done.begun and done.different:
        name, row = next(iter(done.different.items()))
        found = f"a different row {row}: was another version of Softaim used?"
        fault = InputError.at(recording / name, "the rows of the recorded run", found)
    lines = [f"{counted(done.frames, 'frame')} replayed, {done.lacking} of them without a recorded picture"]
    for name, n in done.rows.items():
        same = "the same, bit for bit" if name not in done.different else f"row {done.different[name]} differs"
        lines.append(f"{n} rows of {name}: {same}")
    if not done.begun:
        lines.append("The recording began in the middle of its run: the filter had used earlier frames")
    return Answer({"out": out, **asdict(done)}, [*lines, f"Tables in {out}"], fault)


def compare(
    run: Run,
    recording: RecordingFolder,
    out: Out,
    scene: SceneFile = None,
    methods: Annotated[str | None, Option(help="Names of methods, separated by commas; default: all.")] = None,
    vector: Vector = None,
    force: Force = False,
) -> Answer:
    """Track the target with the paper's method, Softaim's filter and textbook filters, on the same marks."""
    from experiments.commands.console import sentence, track_table
    from experiments.formats.recording import read_recording
    from experiments.pipeline.compare import chosen, summary, write_comparison
    from experiments.pipeline.compare import compare as compared
    from experiments.pipeline.line import FILTER
    from experiments.pipeline.track import verdict_of
    from experiments.plots.compare import comparison_figure
    from experiments.plots.style import write_picture

    named = chosen(methods)
    opened = read_recording(recording, scene, run.stage("read"))
    with run.folder(out, force=force, inputs=[recording, scene]) as folder:
        run.use(opened.scene, before="track")
        done = compared(opened, named, run.stage)
        write_comparison(done, folder)
        write_picture(comparison_figure(done), folder / "compare.png", vector)
    figures = summary(done)
    lines = [f"{FILTER}: {sentence(verdict_of(done))}", f"Tables and a picture in {out}"]
    return Answer({"out": out, "summary": figures}, [track_table(figures), *lines])


def identify(
    run: Run,
    recording: Annotated[Path, Argument(help="Calibration recording that also shows the target's mark.")],
    out: SceneOut,
    scene: SceneFile = None,
    at_rest: Annotated[
        bool, Option("--at-rest", help="Estimate only rest lengths, from a recording of the body at rest.")
    ] = False,
    minutes: Minutes = 5.0,
    force: Replace = False,
) -> Answer:
    """Estimate the tissue's constants and their uncertainty, and write a scene with them."""
    run.not_with("--at-rest", "--minutes")
    from experiments.commands.console import constants_table
    from experiments.engine.spare import spare_cores
    from experiments.formats.outputs import check_new
    from experiments.formats.recording import read_recording
    from experiments.pipeline.identify import (
        check_shown,
        constants,
        fit_lines,
        identification_report,
        identified_scene,
        marks_in,
        resting_scene,
    )

    opened = read_recording(recording, scene, run.stage("read"))
    check_new(out, force)
    run.use(opened.scene, before=None if at_rest else "identify")
    network = opened.scene.network
    check_shown(opened, [network.names[i] for i in network.free] if at_rest else [opened.scene.target.node])
    if at_rest:
        frames = marks_in(opened, run.stage("marks"))
        run.write_scene(resting_scene(opened, frames), out, "at-rest", recording=recording, inputs=[scene])
        next_line = f"next: softaim identify CALIBRATION --scene {out} --out identified.toml"
        rests = f"Scene in {out}, with the rest shape of the recording; {next_line}"
        return Answer({"out": out}, [rests])
    with spare_cores(ahead=opened.marks is None) as workers:
        frames = marks_in(opened, run.stage("marks"))
        found_scene, found = identified_scene(opened, frames, minutes, run.stage("identify"), workers)
    report = identification_report(found, found_scene.mesh)
    kept = [one["name"] for one in constants(found, found_scene.mesh) if one["kept"]]
    run.write_scene(found_scene, out, "identify", recording=recording, inputs=[scene], kept=kept)
    next_line = f"Scene in {out}; next: softaim tune REC --out tuned.toml --scene {out}"
    return Answer({"out": out, **report}, [constants_table(report), *fit_lines(found, minutes), next_line])


def tune(
    run: Run,
    recording: RecordingFolder,
    out: SceneOut,
    scene: SceneFile = None,
    minutes: Minutes = 5.0,
    force: Replace = False,
) -> Answer:
    """Estimate the size of the model's errors from a recording without truth; write a scene with the result."""
    from experiments.commands.console import levels_table
    from experiments.engine.spare import spare_cores
    from experiments.formats.outputs import check_new
    from experiments.formats.recording import read_recording
    from experiments.pipeline.identify import marks_in, time_lines, tuned_scene, tuning_report

    opened = read_recording(recording, scene, run.stage("read"))
    check_new(out, force)
    run.use(opened.scene, before="tune")
    with spare_cores(ahead=opened.marks is None) as workers:
        frames = marks_in(opened, run.stage("marks"))
        found_scene, found = tuned_scene(opened, frames, minutes, run.stage("tune"), workers)
    run.write_scene(found_scene, out, "tune", recording=recording, inputs=[scene])
    report = tuning_report(found)
    next_line = f"Scene in {out}; next: softaim track REC --scene {out} --out DIR"
    return Answer({"out": out, **report}, [levels_table(report), *time_lines(found, minutes), next_line])


def live(
    run: Run,
    source: Annotated[
        list[str] | None,
        Option(
            help="Camera index, device, film, folder, stream, recording, phantom; for marks: udp://:PORT, - (pipe), "
            "marks.csv; for several cameras: NAME=SOURCE for each. Default: phantom."
        ),
    ] = None,
    scene: SceneFile = None,
    out: Annotated[Path | None, Option(help="Output folder; default: live-DATE-TIME.")] = None,
    duration: Annotated[float | None, Option(min=0.0, help="Stop this many seconds after the camera opens.")] = None,
    fps: Fps = None,
    needle: Annotated[Path | None, Option(help="Needle file; switches advice on.")] = None,
    film: WithFilm = False,
    record: Annotated[bool, Option("--record", help="Record all frames, for `softaim replay`.")] = False,
    page: Annotated[str | None, Option(help="Address of the web page; default: 127.0.0.1:8765.")] = None,
    no_page: Annotated[bool, Option("--no-page", help="Serve no web page.")] = False,
    openigtlink: Annotated[
        str | None, Option(help="Address of the OpenIGTLink server, such as 127.0.0.1:18944.")
    ] = None,
    force: Force = False,
) -> Answer:
    """Track the target in live frames until Ctrl-C; each step uses the newest frame."""
    run.not_with("--no-page", "--page")
    run.only_with("--out", "--force")
    from experiments.servers.opening import served
    from experiments.simulation.phantom_process import PHANTOM, PhantomProcess

    # the processes of server and phantom import their modules while this process imports its own
    link = run.opened.enter_context(served(page, openigtlink, with_page=not no_page))
    sources = source or [PHANTOM]
    phantom = PhantomProcess(fps=fps) if sources == [PHANTOM] else None
    if phantom is not None:
        run.opened.callback(phantom.release)

    from experiments.film.live_film import LiveFilm
    from experiments.pipeline.live.following import live as followed
    from experiments.pipeline.live.session import ADVICE
    from vision import shown_source

    path = out if out is not None else Path(time.strftime("live-%Y%m%d-%H%M%S"))

    @contextmanager
    def begin(used: Scene) -> Iterator[Path]:
        with run.folder(path, force=force, inputs=[*map(Path, sources), scene, needle], growing=True) as folder:
            run.use(used, before="track")
            yield folder

    films: list[LiveFilm] = []
    growing = path if path.name else path.resolve()

    def filmed(used: Scene, plan: NeedlePlan | None) -> LiveFilm:
        films.append(LiveFilm(used, growing.with_name(f"{growing.name}-film"), plan))
        return films[-1]

    def shows(used: Scene, plan: NeedlePlan | None) -> Attendant:
        from experiments.servers.publisher import Shows

        assert link is not None
        return run.opened.enter_context(Shows(link, used, plan, ", ".join(map(shown_source, sources))))

    done = followed(
        sources,
        scene,
        begin,
        begun=run.begun,
        duration_s=duration,
        fps=fps,
        needle_path=needle,
        film=filmed if film else None,
        attendant=None if link is None else shows,
        record=record,
        phantom=phantom,
    )
    refused = "".join(f", {n} {kind}" for kind, n in (done["refused"] or {}).items())
    by_status = ", ".join(f"{n} {status}" for status, n in done["statuses"].items())
    frames, predictions = counted(done["frames"], "frame"), counted(done["without_frame"], "prediction")
    counts = (
        f"{frames}, {predictions} without one ({by_status}), "
        f"{done['dropped']} dropped, {done['not_used']} not used{refused}; "
        f"latency median {done['p50_ms']:.1f} ms, 99th percentile {done['p99_ms']:.1f} ms, "
        f"worst {done['worst_ms']:.1f} ms, {counted(done['deadlines_missed'], 'deadline')} missed"
    )
    lines = [counts, f"Estimates in {path / 'estimates.csv'}"]
    if done["advice"] is not None:
        given = ", ".join(f"{name} {n}" for name, n in done["advice"].items())
        lines.append(f"Advice in {path / ADVICE}: {given}")
    lines += [f"Recording in {folder}; next: softaim replay {folder}" for folder in done["recordings"]]
    for one in films:
        paths = ", ".join(str(path / file.name) for file in one.written)
        lines.append(f"Film in {paths or 'no file'}: {counted(one.n_written, 'frame')}, {one.n_dropped} dropped")
    fault = done["fault"] or next((f"film: {one.fault}" for one in films if one.fault is not None), None)
    written = {"film": [{"frames": one.n_written, "dropped": one.n_dropped} for one in films]} if film else {}
    return Answer({"out": path, **done, **written}, lines, None if fault is None else InputError(fault))
