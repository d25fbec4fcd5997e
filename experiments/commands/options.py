"""Options that several subcommands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from typer import Argument, Option

SHIPPED = tuple(sorted(path.stem for path in Path(__file__).parents[1].glob("scenarios/*.toml")))
"""Names of the shipped scenarios."""


def scenarios(incomplete: str) -> list[str]:
    """Shell completions for the start of a scenario's name: names of shipped scenarios, and files."""
    start = Path(incomplete)
    folder, name = (start, "") if incomplete.endswith("/") else (start.parent, start.name)
    files = sorted(str(path) for path in folder.glob("*.toml") if path.name.startswith(name))
    return [*(name for name in SHIPPED if name.startswith(incomplete)), *files]


ScenarioName = Annotated[
    str, Argument(help=f"Scenario file, or shipped scenario: {', '.join(SHIPPED)}.", autocompletion=scenarios)
]
Out = Annotated[Path, Option("--out", help="Output folder; created if missing.", show_default=False)]
Force = Annotated[bool, Option("--force", help="Write into a folder that is not empty.")]
RecordingFolder = Annotated[Path, Argument(help="Folder of the recording.")]

SLOWEST_FPS, FASTEST_FPS = 0.2, 1000.0
"""Least and largest frame rate of a recording [1/s]: 1 / `LONGEST_S` and 1 / `SHORTEST_S`; choice."""

LEAST_MM, MOST_MM = 0.5, 500.0
"""Least and largest side of a printed square or marker of a board [mm]; choice: between a glass target and a wall."""

Fps = Annotated[
    float | None,
    Option(
        "--fps",
        min=SLOWEST_FPS,
        max=FASTEST_FPS,
        help="Frame rate [frames/s] of a picture folder or the phantom; replaces a film's rate.",
    ),
]
SceneFile = Annotated[Path | None, Option("--scene", help="Scene file to use in place of the scene of the recording.")]
WithFilm = Annotated[
    bool,
    Option(
        "--film",
        help="Write an annotated film.avi (in space film.NAME.avi for each camera) and worst.png (worst frames).",
    ),
]
SceneOut = Annotated[Path, Option("--out", help="Scene file to write.", show_default=False)]
AsJson = Annotated[bool, Option("--json", help="Print the result as one JSON object; messages go to standard error.")]
Vector = Annotated[Literal["pdf", "svg"] | None, Option("--vector", help="Also write each picture as a vector file.")]
Verbose = Annotated[bool, Option("--verbose", "-v", help="Report inputs, choices and the time of each stage.")]
Replace = Annotated[bool, Option("--force", help="Replace an existing file.")]
Processes = Annotated[
    int | None, Option("--processes", min=1, help="Number of processes on this machine; default: one per core.")
]
Scheduler = Annotated[str | None, Option("--scheduler", help="Address of a Dask scheduler that distributes the runs.")]
Minutes = Annotated[float, Option("--minutes", min=0.01, help="Time limit [min]; then the best result is written.")]
