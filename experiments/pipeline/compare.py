"""Our filter, the paper's method and textbook filters on the same marks of one recording: `softaim compare`.

Marks are found once, by the line that runs our filter and the paper's method; the others are given the same marks. Each
method has the physics, the start and the belief about forces that our filter has. The extended, stock unscented and
ensemble filters believe in one mode, the poked one; the particle filter in all, and stands for the optimum. The
smoother is our filter's, and knows the marks of all frames.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from estimators import (
    Baseline,
    EnsembleKalmanFilter,
    ExtendedKalmanFilter,
    ParticleFilter,
    StockUnscented,
    TissueFilter,
    fixed_interval,
)
from experiments.errors import InputError, shown
from experiments.formats.estimate_rows import AXES
from experiments.formats.recording import Recording
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import FILTER, OPEN_LOOP, Step
from experiments.pipeline.track import Advance, Track, figures, table, track

EKF, STOCK, ENSEMBLE, PARTICLES, SMOOTHER = "ekf", "filterpy-ukf", "enkf", "particles", "smoother"
METHODS = (OPEN_LOOP, FILTER, EKF, STOCK, ENSEMBLE, PARTICLES, SMOOTHER)

SEED = 0
"""Of the methods that draw random numbers: the same recording gives the same tables."""

COLOURS = dict(zip(METHODS, ("#e07b16", "#1f6fb4", "#8c564b", "#9467bd", "#2ca02c", "#d62728", "#17a2b8"), strict=True))


def baseline(name: str, scene: Scene) -> Baseline:
    """A method that a track does not run, at its beginning."""
    scene_of = scene.network, scene.target.node, scene.measured_nodes, scene.settings
    if name == EKF:
        return ExtendedKalmanFilter(*scene_of)
    if name == STOCK:
        return StockUnscented(*scene_of)
    rng = np.random.default_rng(SEED)
    return EnsembleKalmanFilter(*scene_of, rng=rng) if name == ENSEMBLE else ParticleFilter(*scene_of, rng=rng)


def chosen(text: str) -> tuple[str, ...]:
    """The methods named, separated by commas, those of a track always among them; raises InputError."""
    named = [name.strip() for name in text.split(",")]
    for name in named:
        if name not in METHODS:
            raise InputError.at("--methods", f"some of {', '.join(METHODS)}", shown(name))
    return tuple(name for name in METHODS if name in named or name in (OPEN_LOOP, FILTER))


def compare(
    recording: Recording,
    methods: Sequence[str] = METHODS,
    stage: Callable[[str], Advance] = lambda _name: lambda _share: None,
) -> Track:
    """A track whose steps hold the estimates of these methods; stage(name) gives what is told the share done.

    Raises InputError, SourceError.
    """
    done = track(recording, stage("track"))
    for name in methods:
        if name == SMOOTHER:
            done = replace(done, steps=_smoothed(done, stage(name)))
        elif name not in (OPEN_LOOP, FILTER):
            done = replace(done, steps=_followed(done, name, baseline(name, recording.scene), stage(name)))
    return done


def _smoothed(done: Track, advance: Advance) -> tuple[Step, ...]:
    """The steps of a track with what our filter's smoother says, which knows the marks of all frames."""
    scene = done.recording.scene
    measured = frozenset(scene.measured_nodes)
    tissue = TissueFilter(
        scene.network,
        scene.target.node,
        scene.measured_nodes,
        scene.settings,
        uncertainty=scene.uncertainty,
        n_calibration=scene.n_calibration,
    )
    frames = [
        (step.estimates[FILTER].time_s, [mark for mark in step.marks if mark.node in measured]) for step in done.steps
    ]
    began = time.perf_counter()
    estimates = fixed_interval(tissue, frames)
    seconds = (time.perf_counter() - began) / len(frames)
    advance(1.0)
    return tuple(
        replace(step, estimates=step.estimates | {SMOOTHER: one}, method_s=step.method_s | {SMOOTHER: seconds})
        for step, one in zip(done.steps, estimates, strict=True)
    )


def _followed(done: Track, name: str, method: Baseline, advance: Advance) -> tuple[Step, ...]:
    """The steps of a track with the estimates of one more method."""
    measured = frozenset(done.recording.scene.measured_nodes)
    steps = []
    for k, step in enumerate(done.steps):
        marks = [mark for mark in step.marks if mark.node in measured]
        began = time.perf_counter()
        method.predict(step.estimates[FILTER].time_s)
        estimate = method.update(marks)
        seconds = time.perf_counter() - began
        steps.append(
            replace(step, estimates=step.estimates | {name: estimate}, method_s=step.method_s | {name: seconds})
        )
        advance((k + 1) / len(done.steps))
    return tuple(steps)


def methods_of(done: Track) -> list[str]:
    """The methods that were run, in the order of METHODS."""
    return [method for method in METHODS if method in done.steps[0].estimates]


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
    for ax, method in zip(axes, methods, strict=True):
        rows = table(done, method)
        predicted = np.sqrt(rows[traces].sum(axis=1, skipna=False).to_numpy())
        ax.fill_between(done.times_s, 0.0, predicted, color=COLOURS[method], alpha=0.25, lw=0, label="predicted sigma")
        ax.plot(done.times_s, rows["err_mm"], color=COLOURS[method], lw=0.9, label="error")
        mean = rows["err_mm"].mean()
        ax.set_title(method if np.isnan(mean) else f"{method}: mean error {mean:.2f} mm", loc="left")
        ax.set(ylabel="[mm]", xlim=(done.times_s[0], done.times_s[-1]), ylim=(0.0, None))
        ax.spines[["top", "right"]].set_visible(False)
    axes[1].legend(loc="upper right", ncols=2, framealpha=0.9)
    axes[-1].set_xlabel("time [s]")
    return figure
