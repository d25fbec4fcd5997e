"""One run of the study: a body and a seed, the filter without some of its mechanisms, its figures."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from estimators import FilterSettings, MarkMeasurement, Status, coverage, normalised_error_squared
from experiments.arrays import Floats
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.filter import ADAPTED
from experiments.pipeline.line import FILTER, Line
from experiments.simulation.simulate import scene_of, true_motion
from experiments.studies.ablation.switches import turned_off
from experiments.studies.faults.judge import is_wrong
from experiments.studies.honesty import run as honesty
from experiments.studies.lungs.estimate import SEEN, filtered
from experiments.studies.lungs.landmarks import read_lungs
from experiments.studies.lungs.model import LungConstants
from experiments.studies.zoo import run as zoo
from experiments.studies.zoo.case import Case

Of = Mapping[str, Any]
Figures = dict[str, Any]

MARK_SD_M, SCALE_SD = 4.14e-3, 0.03
"""Of marks of the four masses, an axis [m], the paper's; relative error of the camera's scale, where it has one [1]."""

MISPLACED, MISPLACED_M, EXCHANGED_S = 0.03, 0.15, 4.0
"""Share of marks that are outliers [1], by how much at most an axis [m]; from when on two names are exchanged [s]."""

GAP_S, EACH_S = 1.5, 5.0
"""No marks come for so long at the end of each so many seconds, where there are gaps [s]."""

BLOWS = {"acceleration_m_s2": 300.0, "shortest_s": 0.01, "longest_s": 0.03}
"""Pokes that are impacts: they change a node's velocity by 3 to 9 m/s within a frame."""

STIFFER = 1.5
"""Stiffness of the filter's springs by the true one, where they are wrong [1]."""

STATED = {"stated": 0.5, "tenth": 0.1}
"""The marks' standard deviation as stated, by the true one."""

NOTHING = {"error_m": np.nan, "covered": 0.0, "nees": np.nan, "cpu_s": np.nan, "model_only": 0, "failed": ""}


def run(case: Mapping[str, Any]) -> Figures:
    """The figures of a case: `study` and `of` say which recording it is, `off` which mechanisms are off.

    error_m; covered: share [1]; nees; wrong: frames that may guide on a wrong estimate, and estimates that are not
    finite; lost: frames that may not guide; model_only: frames of the model alone; failed: why it ended early
    cpu_s: processor time
    """
    _load_kernels()
    with turned_off(case["off"]):
        try:
            return NOTHING | STUDIES[case["study"]](case["of"], case["seed"], case["seconds"])
        except (ArithmeticError, ValueError) as error:  # whatever a filter raises is a result of the study
            return NOTHING | {"wrong": 0, "lost": 0, "failed": f"{type(error).__name__}: {error}"}


@cache
def _load_kernels() -> None:
    """Compiled code is loaded before a run is timed."""
    zoo.compile_kernels()
    for trouble in ("camera", "outliers"):
        _phantom({"scenario": "poked", "trouble": trouble}, 0, 0.2)


def _zoo(of: Of, seed: int, seconds: float) -> Figures:
    row = zoo.run(Case(seed=seed, length_s=seconds, **of))
    if not (n := row["frames_done"]):
        raise ValueError(row["ended"])
    lost = n - json.loads(row["status"]).get(Status.TRACKING.value, 0)
    own = {name: row[name] for name in ("error_m", "covered", "nees")}
    own |= {"cpu_s": 1e-3 * row["ms_a_frame"] * n, "failed": row["ended"]}
    return {**own, "wrong": row["wrong_tracking"] + row["non_finite"], "lost": lost}


def _honesty(of: Of, seed: int, seconds: float) -> Figures:
    honesty.body_motion(of["body"], of["pushes"], seed, seconds)
    began = time.process_time()
    row = honesty.run({"stated": 1.0, **of, "seed": seed, "duration_s": seconds})
    own = {name: row[name] for name in ("nees", "wrong", "lost")} | {"cpu_s": time.process_time() - began}
    return {**own, "error_m": 1e-3 * row["error_mm"], "covered": row["covered"] / max(row["frames"] - row["lost"], 1)}


_read_lungs = lru_cache(maxsize=1)(read_lungs)


def _lungs(of: Of, _seed: int, _seconds: float) -> Figures:
    constants, lung = LungConstants(), _read_lungs(Path(of["folder"]))[0]
    began = time.process_time()
    means, covs = filtered(lung, lung.seen(SEEN[of["seen"]]), constants)
    scores = _scores(means[1:] - lung.positions[1:, lung.inner], covs[1:] + constants.reading_sd_m**2 * np.eye(3))
    return {**scores, "wrong": 0, "lost": 0, "cpu_s": time.process_time() - began}


def _scores(errors: Floats, covs: Floats) -> Figures:
    dim = errors.shape[-1]
    nees = normalised_error_squared(errors.reshape(-1, dim), covs.reshape(-1, dim, dim))
    error_m = float(np.linalg.norm(errors, axis=-1).mean())
    return {"error_m": error_m, "covered": coverage(nees, dim), "nees": float(nees.mean() / dim)}


@lru_cache(maxsize=4)
def _positions(scenario: str, seed: int, seconds: float, *, blows: bool) -> tuple[Floats, Floats]:
    own = read_scenario(scenario).model_copy(update={"seed": seed, "duration_s": seconds})
    if blows and own.pokes is not None:
        own = own.model_copy(update={"pokes": own.pokes.model_copy(update=BLOWS)})
    truth = true_motion(scene_of(own).network, own, np.random.default_rng(seed))
    return truth.times_s, truth.positions


def _phantom(of: Of, seed: int, seconds: float) -> Figures:
    """The four masses in a scenario; trouble: one of those of `BODIES`, or none."""
    trouble, rng, scene = of["trouble"], np.random.default_rng([seed, 1]), scene_of(read_scenario(of["scenario"]))
    times_s, positions = _positions(of["scenario"], seed, seconds, blows=trouble == "blows")
    names = [scene.network.names[i] for i in scene.network.free]
    hidden, seen, cov = names.index(scene.target.node), scene.measured_nodes, MARK_SD_M**2 * np.eye(scene.network.dim)
    camera = replace(scene.cameras[0], scale_sd=SCALE_SD if trouble == "camera" else None)
    scene = replace(scene, cameras=(camera,), settings=FilterSettings())
    if trouble == "stated":
        scene = replace(scene, settings=replace(scene.settings, marks_bounds=ADAPTED))
    if trouble == "check":
        scene = replace(scene, network=replace(scene.network, stiffness=STIFFER * scene.network.stiffness))
    cov = STATED.get(trouble, 1.0) ** 2 * cov
    off, frames = rng.normal(), []
    for k, (time_s, places) in enumerate(zip(times_s, positions, strict=True)):
        noisy = places + rng.normal(0.0, MARK_SD_M, places.shape)
        astray = rng.random(len(names)) < MISPLACED
        astray[0] |= k == 0
        if trouble == "outliers":
            noisy += astray[:, None] * rng.uniform(-MISPLACED_M, MISPLACED_M, places.shape)
        errors = camera.calibration_error(places)
        noisy += off * errors.sum(axis=-1)
        called = (seen[1], seen[0], *seen[2:]) if trouble == "names" and time_s > EXCHANGED_S else seen
        if trouble == "gaps" and time_s % EACH_S > EACH_S - GAP_S:
            called = ()
        at = [(name, names.index(node)) for name, node in zip(called, seen, strict=False)]
        frames.append(
            [MarkMeasurement(name, noisy[i], cov, shared=errors[i] if camera.scale_sd else None) for name, i in at]
        )
    began = time.process_time()
    line = Line(scene, baseline=False, check=trouble == "check")
    found = [line.take(float(t), marks).estimates[FILTER] for t, marks in zip(times_s, frames, strict=True)]
    scores = _scores(np.array([one.mean for one in found]) - positions[:, hidden], np.array([one.cov for one in found]))
    wrong = [is_wrong(one.mean, one.cov, p[hidden]) for one, p in zip(found, positions, strict=True)]
    guiding = np.array([one.status in (Status.TRACKING, Status.COASTING) for one in found])
    counts = {"wrong": int((guiding & wrong).sum()), "lost": int((~guiding).sum())}
    model_only = sum(one.model_only for one in found)
    return {**scores, **counts, "model_only": model_only, "cpu_s": time.process_time() - began}


STUDIES = {"zoo": _zoo, "phantom": _phantom, "honesty": _honesty, "lungs": _lungs}
