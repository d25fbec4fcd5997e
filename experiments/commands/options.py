"""Options that several subcommands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Out = Annotated[Path, typer.Option("--out", help="Folder to write to; made if missing.", show_default=False)]
Force = Annotated[bool, typer.Option("--force", help="Write into a folder that is not empty.")]
Fps = Annotated[float | None, typer.Option("--fps", min=0.001, help="Of a folder of pictures: how many a second.")]
SceneFile = Annotated[Path | None, typer.Option("--scene", help="Scene file in place of the recording's own.")]
SceneOut = Annotated[Path, typer.Option("--out", help="Scene file to write.", show_default=False)]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for programs.")]
Processes = Annotated[
    int | None, typer.Option("--processes", min=1, help="On this machine; default: one for each core.")
]
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", help="Address of a Dask scheduler, in place of this machine.")
]
Minutes = Annotated[float, typer.Option("--minutes", min=0.01, help="Ends after so long with the best until then.")]
