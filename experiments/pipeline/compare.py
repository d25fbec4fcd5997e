"""Comparison of the filter with the open loop and other methods on a recording's marks, for `softaim compare`.

All methods use the same marks, tissue model and initial state. The extended, standard unscented and ensemble filters
assume brief forces (pokes) at all times. The particle filter approximates the optimal filter. The smoother uses the
marks of all frames and, like the filter, direct measurements of the target (fixes).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from estimators import METHODS, CovarianceError, Method, TrackingProblem, make_method
from experiments.errors import InputError, placed, shown
from experiments.formats.recording import Fix, Recording
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import FILTER, OPEN_LOOP, Step, with_bias_of_fixes
from experiments.pipeline.track import Advance, Track, figures, track, write_estimates

SMOOTHER = "smoother"
"""Name of the smoother, the method in `estimators.METHODS` that `softaim smooth` runs."""


def method_names() -> tuple[str, ...]:
    """Names of all methods for comparison: the open loop, the filter, then those in `estimators.METHODS`."""
    return (OPEN_LOOP, FILTER, *METHODS)


def chosen(text: str | None) -> tuple[str, ...]:
    """The methods in a comma-separated text, plus open loop and filter; if `text` is None, all. Raises InputError."""
    names = method_names()
    named = names if text is None else [name.strip() for name in text.split(",")]
    for name in named:
        if name not in names:
            raise InputError.at("--methods", f"some of {', '.join(names)}", shown(name))
    return tuple(name for name in names if name in named or name in (OPEN_LOOP, FILTER))


def compare(
    recording: Recording,
    methods: Sequence[str] | None = None,
    stage: Callable[[str], Advance] = lambda _name: lambda _share: None,
) -> Track:
    """Track a recording with these methods, or with all methods if `methods` is None.

    stage: takes the name of a stage, and returns the function that reports the progress of this stage
    Raises InputError, SourceError, UnknownMethodError.
    """
    problem = tracking_problem(recording.scene, recording.fixes)
    others = [name for name in (method_names() if methods is None else methods) if name not in (OPEN_LOOP, FILTER)]
    made = {name: make_method(name, problem) for name in others}
    done = track(recording, stage("track"))
    for name, method in made.items():
        with placed(f"{recording.folder}: {name}", CovarianceError):
            done = replace(done, steps=_with_method(done, name, method, stage(name)))
    return done


def tracking_problem(scene: Scene, fixes: Sequence[Fix] = ()) -> TrackingProblem:
    """The input of every method; fixes: direct measurements of the target in the recording."""
    return TrackingProblem(
        scene.network,
        scene.target.point,
        scene.measured_nodes,
        with_bias_of_fixes(scene.settings, fixes),
        uncertainty=scene.uncertainty,
        n_calibration=scene.n_calibration,
        fixes=[(fix.time_s, fix.position_m, fix.cov) for fix in fixes],
    )


def _with_method(done: Track, name: str, method: Method, advance: Advance) -> tuple[Step, ...]:
    """Run one more method; returns the track's steps with this method's estimates and computing time per frame [s]."""
    measured = frozenset(done.recording.scene.measured_nodes)
    frames = [
        (step.estimates[FILTER].time_s, [mark for mark in step.marks if mark.node in measured]) for step in done.steps
    ]
    steps: list[Step] = []
    began = time.perf_counter()
    for block in method.run(frames, advance):
        seconds = (time.perf_counter() - began) / len(block)
        for step, estimate in zip(done.steps[len(steps) :], block, strict=False):
            estimates, method_s = step.estimates | {name: estimate}, step.method_s | {name: seconds}
            steps.append(replace(step, estimates=estimates, method_s=method_s))
        began = time.perf_counter()
    if len(steps) != len(frames):
        raise ValueError(f"{name}: expected an estimate of each of {len(frames)} frames, found {len(steps)}")
    return tuple(steps)


def methods_of(done: Track) -> list[str]:
    """The methods of a track, in the order of `method_names`."""
    return [method for method in method_names() if method in done.steps[0].estimates]


def summary(done: Track) -> dict[str, dict[str, float | int | None]]:
    """The content of summary.json: figures by method, as in `softaim track`."""
    rows = {method: figures(done, method) for method in methods_of(done)}
    return rows | {FILTER: rows[FILTER] | dict(done.counts)}


def write_smoothed(done: Track, folder: Path) -> None:
    """Write tables of the smoother's and the filter's estimates, and summary.json, to an existing folder."""
    write_estimates(done, folder, {SMOOTHER: "estimates.csv", FILTER: f"estimates.{FILTER}.csv"}, summary(done))


def write_comparison(done: Track, folder: Path) -> None:
    """Write estimates.METHOD.csv for each method and summary.json to an existing folder."""
    write_estimates(done, folder, {method: f"estimates.{method}.csv" for method in methods_of(done)}, summary(done))
