"""`softaim live`."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from experiments.commands.options import Force, Fps, SceneFile, WithFilm
from experiments.commands.run import Answer, Run

if TYPE_CHECKING:
    from experiments.formats.needle_file import NeedlePlan
    from experiments.formats.scene.scene import Scene


def live(
    run: Run,
    source: Annotated[
        str,
        typer.Option(
            "--source",
            help="Camera index, device, film, folder, stream, recording, phantom; marks: udp://:PORT, - or marks.csv.",
        ),
    ],
    scene: SceneFile = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder to write to; default: live-DATE-TIME.")] = None,
    duration: Annotated[float | None, typer.Option("--duration", min=0.0, help="Stop after so many seconds.")] = None,
    fps: Fps = None,
    needle: Annotated[Path | None, typer.Option("--needle", help="A needle's file: give advice on it, too.")] = None,
    film: WithFilm = False,
    force: Force = False,
) -> Answer:
    """Follow the target in frames as they come, newest first, until Ctrl-C."""
    from experiments.errors import InputError
    from experiments.film.film import FILM
    from experiments.film.live_film import LiveFilm
    from experiments.pipeline.live.session import ADVICE
    from experiments.pipeline.live.session import live as followed

    path = out if out is not None else Path(time.strftime("live-%Y%m%d-%H%M%S"))

    @contextmanager
    def begin(used: Scene) -> Iterator[Path]:
        with run.folder(path, force=force, inputs=[Path(source), scene, needle], growing=True) as folder:
            run.use(used, before="track")
            yield folder

    films: list[LiveFilm] = []
    growing = path if path.name else path.resolve()

    def filmed(used: Scene, plan: NeedlePlan | None) -> LiveFilm:
        films.append(LiveFilm(used, growing.with_name(f"{growing.name}-film"), plan))
        return films[-1]

    done = followed(
        source,
        scene,
        begin,
        begun=run.begun,
        duration_s=duration,
        fps=fps,
        needle_path=needle,
        film=filmed if film else None,
    )

    def show() -> None:
        refused = "".join(f", {n} {kind}" for kind, n in (done.refused or {}).items())
        counted = ", ".join(f"{n} {status}" for status, n in done.statuses.items())
        print(
            f"{done.frames} frames and {done.without_frame} moments without one ({counted}), "
            f"{done.dropped} dropped, {done.not_used} not used{refused}; "
            f"latency median {done.latency_median_ms:.1f} ms, 99 of 100 {done.latency_p99_ms:.1f} ms, "
            f"worst {done.latency_worst_ms:.1f} ms"
        )
        print(f"Estimates in {path / 'estimates.csv'}")
        if done.advice is not None:
            print(f"Advice in {path / ADVICE}: {', '.join(f'{name} {n}' for name, n in done.advice.items())}")

        for one in films:
            print(f"Film in {path / FILM}: {one.n_written} frames, {one.n_dropped} dropped")

    fault = done.fault or next((f"film: {one.fault}" for one in films if one.fault is not None), None)
    written = {"film": [{"frames": one.n_written, "dropped": one.n_dropped} for one in films]} if film else {}
    return Answer({"out": path, **asdict(done), **written}, show, None if fault is None else InputError(fault))
