"""Simulate, film and track the paper's two scenarios, as `softaim demo` does.

The table of the demo has the form of [paper] section IV: mean absolute error ± SD of the hidden mass in each scenario.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from experiments.formats.outputs import output_folder
from experiments.formats.recording import read_recording
from experiments.formats.scenario import read_scenario
from experiments.pipeline.track import Track, summary, track, write_tables
from experiments.simulation.simulate import simulate

SCENARIOS = ("quiet", "poked")
PAPER_MM = {"quiet": (15.93, 9.28), "poked": (18.29, 12.31)}
"""Published mean and SD of the hidden mass's error [mm]. Frames were 1.09 s apart; the error of marks was 4.14 ± 1.47
mm."""


def tracked(
    name: str,
    recording: Path,
    seed: int | None = None,
    *,
    stage: Callable[[str], Callable[[float], None]] = lambda _name: lambda _share: None,
) -> Track:
    """Film a scenario into the folder `recording`, and track it; stage: see `demo`."""
    scenario = read_scenario(name)
    if seed is not None:
        scenario = scenario.model_copy(update={"seed": seed})
    simulate(scenario, recording, advance=stage(f"{name}: film"))
    return track(read_recording(recording), stage(f"{name}: track"))


def heads() -> tuple[str, ...]:
    """Column headings of the demo's tables: the scenarios with their seeds."""
    return tuple(f"{name}, seed {read_scenario(name).seed}" for name in SCENARIOS)


Figures = dict[str, dict[str, dict[str, float | int | None]]]


def demo(
    out: Path, *, vector: str | None = None, force: bool = False, stage: Callable[[str], Callable[[float], None]]
) -> Figures:
    """Write recordings and tracks of both scenarios to the folder `out`; returns figures by scenario and method.

    vector: second file format of each plot, "pdf" or "svg"; None for no second file
    stage: function that begins a part of the work, with the part's name as argument. The function returns another
        function, which reports the progress of the part, from 0 to 1.
    """
    from experiments.plots.track import write_track_plots  # imported here, because matplotlib is slow to load

    with output_folder(out, force=force) as folder:
        figures: Figures = {}
        for name in SCENARIOS:
            done = tracked(name, folder / name / "recording", stage=stage)
            drawn = stage(f"{name}: plots")
            write_tables(done, folder / name)
            write_track_plots(done, folder / name, vector)
            drawn(1.0)
            figures[name] = summary(done)
        (folder / "summary.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    return figures
