"""The filter, the open loop and the registered methods on the same marks of one recording: `softaim compare`.

The track finds the marks once, and runs the filter and the open loop; the methods of `estimators.METHODS` are given the
same marks. Each method has the physics, the start and the force model of the filter. The extended, stock unscented and
ensemble filters use one mode, the poked one; the particle filter uses all, and stands for the optimum. The smoother
uses the marks of all frames.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from estimators import METHODS, Method, TrackingProblem, make_method
from experiments.errors import InputError, shown
from experiments.formats.estimate_rows import AXES
from experiments.formats.recording import Recording
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import FILTER, OPEN_LOOP, Step
from experiments.pipeline.track import Advance, Track, figures, table, track

COLOURS = ("#e07b16", "#1f6fb4", "#8c564b", "#9467bd", "#2ca02c", "#d62728", "#17a2b8")


def method_names() -> tuple[str, ...]:
    """All methods that can be compared: those of a track, then the registered ones."""
    return (OPEN_LOOP, FILTER, *METHODS)


def chosen(text: str | None) -> tuple[str, ...]:
    """The methods named, separated by commas, and those of a track; all where text is None. Raises InputError."""
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
    """A track whose steps hold the estimates of these methods, all where None; stage(name) gets the share done.

    Raises InputError, SourceError, UnknownMethodError.
    """
    problem = tracking_problem(recording.scene)
    others = [name for name in (method_names() if methods is None else methods) if name not in (OPEN_LOOP, FILTER)]
    made = {name: make_method(name, problem) for name in others}
    done = track(recording, stage("track"))
    for name, method in made.items():
        done = replace(done, steps=_with_method(done, name, method, stage(name)))
    return done


def tracking_problem(scene: Scene) -> TrackingProblem:
    """What a scene gives every method."""
    return TrackingProblem(
        scene.network,
        scene.target.point,
        scene.measured_nodes,
        scene.settings,
        uncertainty=scene.uncertainty,
        n_calibration=scene.n_calibration,
    )


def _with_method(done: Track, name: str, method: Method, advance: Advance) -> tuple[Step, ...]:
    """The steps of a track with the estimates of one more method, and the seconds a frame that it took."""
    measured = frozenset(done.recording.scene.measured_nodes)
    frames = [
        (step.estimates[FILTER].time_s, [mark for mark in step.marks if mark.node in measured]) for step in done.steps
    ]
    steps: list[Step] = []
    began = time.perf_counter()
    for block in method.run(frames):
        seconds = (time.perf_counter() - began) / len(block)
        for step, estimate in zip(done.steps[len(steps) :], block, strict=False):
            estimates, method_s = step.estimates | {name: estimate}, step.method_s | {name: seconds}
            steps.append(replace(step, estimates=estimates, method_s=method_s))
        advance(len(steps) / len(frames))
        began = time.perf_counter()
    if len(steps) != len(frames):
        raise ValueError(f"{name}: expected an estimate of each of {len(frames)} frames, found {len(steps)}")
    return tuple(steps)


def methods_of(done: Track) -> list[str]:
    """The methods that were run, in the order of `method_names`."""
    return [method for method in method_names() if method in done.steps[0].estimates]


def summary(done: Track) -> dict[str, dict[str, float | int | None]]:
    """What summary.json holds: figures by method, as `softaim track` has them."""
    rows = {method: figures(done, method) for method in methods_of(done)}
    return rows | {FILTER: rows[FILTER] | dict(done.counts)}


def write_comparison(done: Track, folder: Path) -> None:
    """Write estimates.METHOD.csv for each method, summary.json and compare.png to a folder that exists."""
    for method in methods_of(done):
        table(done, method).to_csv(folder / f"estimates.{method}.csv", index=False, float_format="%.9g")
    (folder / "summary.json").write_text(json.dumps(summary(done), indent=2) + "\n", encoding="utf-8")
    comparison_figure(done).savefig(folder / "compare.png", dpi=110)


def comparison_figure(done: Track) -> Figure:
    """Error of each method over time under what it predicted: the root of the trace of its covariance."""
    with mpl.rc_context({"font.size": 9}):
        methods = methods_of(done)
        figure = Figure(figsize=(11, 1.6 * len(methods)), layout="constrained")
        axes = figure.subplots(len(methods), sharex=True, sharey=True)
    traces = [AXES[a] * 2 for a in range(done.recording.scene.network.dim)]
    colours = dict(zip(method_names(), cycle(COLOURS), strict=False))
    for ax, method in zip(axes, methods, strict=True):
        rows, colour = table(done, method), colours[method]
        predicted = np.sqrt(rows[traces].sum(axis=1, skipna=False).to_numpy())
        ax.fill_between(done.times_s, 0.0, predicted, color=colour, alpha=0.25, lw=0, label="predicted sigma")
        ax.plot(done.times_s, rows["err_mm"], color=colour, lw=0.9, label="error")
        mean = rows["err_mm"].mean()
        ax.set_title(method if np.isnan(mean) else f"{method}: mean error {mean:.2f} mm", loc="left")
        ax.set(ylabel="[mm]", xlim=(done.times_s[0], done.times_s[-1]), ylim=(0.0, None))
        ax.spines[["top", "right"]].set_visible(False)
    axes[1].legend(loc="upper right", ncols=2, framealpha=0.9)
    axes[-1].set_xlabel("time [s]")
    return figure
