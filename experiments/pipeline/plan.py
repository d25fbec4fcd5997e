"""Planning of needle paths: what `softaim plan` does."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from dynamics import rest_shape
from estimators import Plan, PlannedTarget, Status, TissueModel, candidate_paths, target_map
from estimators import plan as ranked
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.estimate_rows import AXES
from experiments.formats.plan_file import Task, read_task
from experiments.formats.recording import read_recording
from experiments.formats.scene.mesh import ON_SKIN_M, outside_m
from experiments.formats.scene.scene import Scene, usable_scene
from experiments.log import LOG
from experiments.pipeline.integrity import IntegrityMonitor
from experiments.pipeline.line import FILTER, Line
from experiments.pipeline.track import each_frame

Advance = Callable[[float], None]

SHOWN = 4
"""Largest number of paths that are listed after the best path."""

APART = 10e-3
"""Least distance between the entry points of listed paths [m]; choice."""


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """A plan; estimate: status of the target's estimate, or "at rest"; time_s: the estimate's time [s], or None."""

    scene: Scene
    task: Task
    lesion: PlannedTarget
    plan: Plan
    estimate: str
    time_s: float | None


def planned(
    source: Path,
    plan_path: Path,
    scene_path: Path | None = None,
    stage: Callable[[str], Advance] = lambda _name: lambda _share: None,
) -> Planned:
    """Plan paths for a recording's folder or a scene file; raises InputError, SourceError, NetworkError.

    scene_path: file of a scene that replaces the scene in the recording's folder
    """
    if source.is_dir() or scene_path is not None:
        recording = read_recording(source, scene_path, stage("read"))
        advance = stage("track")
        scene = recording.scene
        task = read_task(plan_path, scene.network.dim)
        line = Line(scene, baseline=False, fixes=recording.fixes)
        integrity = IntegrityMonitor(scene, line.filter)
        for k, (_, step) in enumerate(each_frame(line, recording), start=1):
            integrity.take(step.estimates[FILTER], line.used(step))
            advance(k / len(recording.exposures_s))
        ahead = line.filter.predict_at(float(recording.exposures_s[-1]) + task.arrival_s)
        trusted = ahead.status in (Status.TRACKING, Status.COASTING)
        unfit = integrity.contradiction.reason or (None if trusted else str(ahead.status))
        if unfit is not None or ahead.cov is None:
            expected = "a last estimate that is TRACKING or COASTING, without a contradiction"
            raise InputError.at(source, expected, str(unfit))
        mean, cov, estimate, time_s = ahead.mean, ahead.cov + integrity.unstated, str(ahead.status), ahead.time_s
    else:
        scene = usable_scene(source)
        task = read_task(plan_path, scene.network.dim)
        shape = rest_shape(scene.network)
        model = TissueModel(scene.network, scene.measured_nodes, uncertainty=scene.uncertainty)
        target = target_map(scene.network, scene.target.point)
        columns = target.linear(model.resting_columns(shape))
        mean = target.position(shape[scene.network.free].ravel())
        cov = task.target_sd_m**2 * np.eye(scene.network.dim) + columns @ columns.T
        estimate, time_s = "at rest", None
    lesion = PlannedTarget(mean, cov, scene.target.radius_m)
    common = (scene.network, scene.target.point, lesion, task.needle)
    skin = task.skin.entries(task.n_entries)
    if not (np.linalg.norm(skin - mean, axis=1) > lesion.radius_m).all():
        raise InputError.at(f"{plan_path}: entry", "a segment of skin outside the lesion", "one that touches it")
    entries, tips = candidate_paths(*common, skin, task.n_aims)
    found = ranked(*common, task.skin, task.obstacles, entries=entries, tips=tips)
    if scene.mesh is not None and (air_m := float(outside_m(scene.mesh, skin).max())) > ON_SKIN_M:
        where = f"entries are up to {1e3 * air_m:.1f} mm outside the body at rest"
        LOG.warning("%s: %s; the path through air counts as depth", plan_path, where)
    return Planned(scene, task, lesion, found, estimate, time_s)


def table(done: Planned) -> pd.DataFrame:
    """All paths for plan.csv, the best first and rejected paths last."""
    found, axes = done.plan, AXES[: done.scene.network.dim]
    columns: dict[str, Any] = {"rank": np.arange(1, len(found.order) + 1)}
    for name, places in (("entry", found.entries), ("tip", found.tips), ("pushed", found.pushed)):
        columns |= {f"{name}_{axis}_mm": 1e3 * places[found.order, a] for a, axis in enumerate(axes)}
    columns |= {
        "depth_mm": 1e3 * found.lengths[found.order],
        "angle_deg": np.degrees(found.angles[found.order]),
        "hit_probability": found.hits[found.order],
        "clearance_mm": 1e3 * found.clearance[found.order],
        "rejected": ["; ".join(found.reasons[k]) for k in found.order],
    }
    return pd.DataFrame(columns)


def next_best(found: Plan) -> list[int]:
    """Rows of the best path and of at most `SHOWN` further paths; their entry points are at least `APART` apart."""
    chosen: list[int] = []
    for k in found.order[: int(found.allowed.sum())]:
        if all(np.linalg.norm(found.entries[k] - found.entries[i]) >= APART for i in chosen):
            chosen.append(int(k))
        if len(chosen) > SHOWN:
            break
    return chosen


def report(done: Planned) -> dict[str, Any]:
    """The content of plan.json; `best` is None if every path is rejected."""
    found, lesion = done.plan, done.lesion
    chosen = next_best(found)
    return {
        "version": 1,
        "target": {
            "node": done.scene.target.node,
            "estimate": done.estimate,
            "time_s": done.time_s,
            "mean_mm": _mm(lesion.mean),
            "cov_mm2": (1e6 * lesion.cov).round(6).tolist(),
            "radius_mm": 1e3 * lesion.radius_m,
        },
        "best": _path(found, chosen[0]) if chosen else None,
        "next_best": [_path(found, k) for k in chosen[1:]],
        "paths": len(found.order),
        "allowed": int(found.allowed.sum()),
        "rejected_by": dict(Counter(reason for reasons in found.reasons for reason in reasons)),
    }


def _path(found: Plan, k: int) -> dict[str, Any]:
    return {
        "entry_mm": _mm(found.entries[k]),
        "tip_mm": _mm(found.tips[k]),
        "direction": found.directions[k].round(6).tolist(),
        "depth_mm": round(1e3 * float(found.lengths[k]), 3),
        "angle_deg": round(float(np.degrees(found.angles[k])), 3),
        "hit_probability": round(float(found.hits[k]), 4),
        "clearance_mm": round(1e3 * float(found.clearance[k]), 3) if np.isfinite(found.clearance[k]) else None,
        "pushed_mm": _mm(found.pushed[k]),
        "target_at_arrival_mm": _mm(found.means[k]),
    }


def _mm(place: Floats) -> list[float]:
    return [round(1e3 * float(x), 3) + 0.0 for x in place]


def write_plan(done: Planned, folder: Path) -> None:
    """Write plan.csv and plan.json into an existing folder."""
    table(done).to_csv(folder / "plan.csv", index=False, float_format="%.6g")
    (folder / "plan.json").write_text(json.dumps(report(done), indent=2, allow_nan=False) + "\n", encoding="utf-8")
