"""Options that several subcommands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

SHIPPED = tuple(sorted(path.stem for path in Path(__file__).parents[1].glob("scenarios/*.toml")))
"""Names of the scenarios that come with the program, listed without loading what reads them."""


def scenarios(incomplete: str) -> list[str]:
    """Scenarios for a shell that completes a name: shipped ones, and files."""
    start = Path(incomplete)
    folder, name = (start, "") if incomplete.endswith("/") else (start.parent, start.name)
    files = sorted(str(path) for path in folder.glob("*.toml") if path.name.startswith(name))
    return [*(name for name in SHIPPED if name.startswith(incomplete)), *files]


ScenarioName = Annotated[
    str,
    typer.Argument(help=f"A scenario file, or one that comes along: {', '.join(SHIPPED)}.", autocompletion=scenarios),
]
Out = Annotated[Path, typer.Option("--out", help="Folder to write to; made if missing.", show_default=False)]
Force = Annotated[bool, typer.Option("--force", help="Write into a folder that is not empty.")]
RecordingFolder = Annotated[Path, typer.Argument(help="Folder of the recording.")]
Fps = Annotated[
    float | None,
    typer.Option(
        "--fps", min=0.001, max=1e5, help="Frames a second: of pictures, the phantom, or a film in place of its own."
    ),
]
SceneFile = Annotated[Path | None, typer.Option("--scene", help="Scene file in place of the recording's own.")]
WithFilm = Annotated[bool, typer.Option("--film", help="Write what the camera saw, too: film.avi, worst.png.")]
SceneOut = Annotated[Path, typer.Option("--out", help="Scene file to write.", show_default=False)]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print one JSON object in place of text; messages are on standard error.")
]
Vector = Annotated[
    Literal["pdf", "svg"] | None, typer.Option("--vector", help="Write each picture as a vector file, too.")
]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Say what is read and chosen, and how long each stage took.")
]
Replace = Annotated[bool, typer.Option("--force", help="Replace a file that is there.")]
Processes = Annotated[
    int | None, typer.Option("--processes", min=1, help="On this machine; default: one for each core.")
]
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", help="Address of a Dask scheduler, in place of this machine.")
]
Minutes = Annotated[float, typer.Option("--minutes", min=0.01, help="Ends after so long with the best until then.")]
