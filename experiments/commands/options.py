"""Options that several subcommands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

SHIPPED = tuple(sorted(path.stem for path in Path(__file__).parents[1].glob("scenarios/*.toml")))
"""Names of the shipped scenarios, listed without loading their reader."""


def scenarios(incomplete: str) -> list[str]:
    """Completions for a scenario: shipped ones, and files."""
    start = Path(incomplete)
    folder, name = (start, "") if incomplete.endswith("/") else (start.parent, start.name)
    files = sorted(str(path) for path in folder.glob("*.toml") if path.name.startswith(name))
    return [*(name for name in SHIPPED if name.startswith(incomplete)), *files]


ScenarioName = Annotated[
    str,
    typer.Argument(help=f"A scenario file, or a shipped one: {', '.join(SHIPPED)}.", autocompletion=scenarios),
]
Out = Annotated[Path, typer.Option("--out", help="Output folder; created if missing.", show_default=False)]
Force = Annotated[bool, typer.Option("--force", help="Write into a folder that is not empty.")]
RecordingFolder = Annotated[Path, typer.Argument(help="Folder of the recording.")]
Fps = Annotated[
    float | None,
    typer.Option(
        "--fps",
        min=0.001,
        max=1e5,
        help="Frame rate [frames/s] of pictures or the phantom, or in place of a film's own.",
    ),
]
SceneFile = Annotated[Path | None, typer.Option("--scene", help="Scene file in place of the recording's own.")]
WithFilm = Annotated[bool, typer.Option("--film", help="Also write an annotated film: film.avi, worst.png.")]
SceneOut = Annotated[Path, typer.Option("--out", help="Scene file to write.", show_default=False)]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print one JSON object in place of text; messages go to standard error.")
]
Vector = Annotated[
    Literal["pdf", "svg"] | None, typer.Option("--vector", help="Also write each picture as a vector file.")
]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Report what is read and chosen, and the time of each stage.")
]
Replace = Annotated[bool, typer.Option("--force", help="Replace an existing file.")]
Processes = Annotated[
    int | None,
    typer.Option("--processes", min=1, help="Number of processes on this machine; default: one for each core."),
]
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", help="Address of a Dask scheduler, in place of this machine.")
]
Minutes = Annotated[float, typer.Option("--minutes", min=0.01, help="Time limit; the best result until then is used.")]
