"""`softaim live`."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from experiments.commands.options import Force, Fps, SceneFile, WithFilm
from experiments.commands.run import Answer, Run
from experiments.errors import InputError
from experiments.plain import counted

if TYPE_CHECKING:
    from experiments.formats.needle_file import NeedlePlan
    from experiments.formats.scene.scene import Scene
    from experiments.pipeline.live.following import Attendant


def live(
    run: Run,
    source: Annotated[
        list[str] | None,
        typer.Option(
            "--source",
            help="Camera index, device, film, folder, stream, recording, phantom; for marks: udp://:PORT, - (pipe), "
            "marks.csv; for several cameras: NAME=SOURCE each. Default: phantom.",
        ),
    ] = None,
    scene: SceneFile = None,
    out: Annotated[Path | None, typer.Option("--out", help="Output folder; default: live-DATE-TIME.")] = None,
    duration: Annotated[
        float | None,
        typer.Option("--duration", min=0.0, help="Stop this time [s] after the camera opens."),
    ] = None,
    fps: Fps = None,
    needle: Annotated[Path | None, typer.Option("--needle", help="Needle file; switches advice on.")] = None,
    film: WithFilm = False,
    record: Annotated[bool, typer.Option("--record", help="Record all frames, for `softaim replay`.")] = False,
    page: Annotated[
        str | None, typer.Option("--page", help="Address of the web page; default: 127.0.0.1:8765.")
    ] = None,
    no_page: Annotated[bool, typer.Option("--no-page", help="Serve no web page.")] = False,
    openigtlink: Annotated[
        str | None,
        typer.Option("--openigtlink", help="Address of the OpenIGTLink server, such as 127.0.0.1:18944."),
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
