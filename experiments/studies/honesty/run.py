"""One run of the study: the scene states exact constants, and marks have a given noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from estimators import Status, normalised_error_squared
from experiments.arrays import Floats
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import FILTER, Line
from experiments.studies.estimation.trials import Frames, frames_of
from experiments.studies.faults.judge import is_wrong
from experiments.studies.faults.world import INTERVAL_S
from experiments.studies.faults.wrong_worlds.bodies import scene_of_body
from experiments.studies.faults.wrong_worlds.run import REGION
from experiments.studies.faults.wrong_worlds.truth import Pushes, Truth, motion_of

PUSHES = {
    "nothing": Pushes(0.0, 0.0),
    "breath 1": Pushes(0.0, 1.0),
    "breath 2": Pushes(0.0, 2.0),
    "breath 4": Pushes(0.0, 4.0),
    "pokes": Pushes(5.0, 0.0),
    "both": Pushes(5.0, 2.0),
}
"""Forces on the body, by name: accelerations by pokes, and by a breath with a period of 3 to 6 s [m/s²]."""

AFTER_S = 1.0
"""Time from which frames are evaluated [s]: the start has its own tests."""


def run(case: Mapping[str, Any]) -> dict[str, Any]:
    """Do a run, and return its row.

    case: body; pushes: name of the forces; seed; sd_m: true noise of marks [m]; stated: ratio of stated to true noise
    frames, lost: number of frames, and of frames whose status permits no guidance; the other figures omit lost frames
    covered, wrong: number of frames with the truth in the 95 % region, and with a wrong estimate
    nees: mean NEES per dimension; error_mm, sd_mm: root mean square of error and of standard deviation, for each axis
    """
    scene, frames, truth = recorded(case)
    line = Line(scene, baseline=False)
    estimates = [line.take(time_s, marks).estimates[FILTER] for time_s, marks in frames]
    counted = [(place, one) for place, one in zip(truth, estimates, strict=True) if one.time_s >= AFTER_S]
    guiding = [(place, one) for place, one in counted if one.status in (Status.TRACKING, Status.COASTING)]
    found = {"frames": len(counted), "lost": len(counted) - len(guiding)}
    if not guiding:
        return {**found, "wrong": 0, "covered": 0.0, "nees": np.nan, "error_mm": np.nan, "sd_mm": np.nan}
    errors = np.array([place - one.mean for place, one in guiding])
    covs = np.array([one.cov for _, one in guiding])
    dim, nees = errors.shape[1], normalised_error_squared(errors, covs)
    return {
        **found,
        "wrong": sum(is_wrong(one.mean, one.cov, place) for place, one in guiding),
        "covered": float(np.sum(nees <= REGION[dim])),
        "nees": float(np.mean(nees) / dim),
        "error_mm": 1e3 * float(np.sqrt(np.mean(errors**2))),
        "sd_mm": 1e3 * float(np.sqrt(np.trace(covs, axis1=1, axis2=2).mean() / dim)),
    }


def recorded(case: Mapping[str, Any]) -> tuple[Scene, Frames, list[Floats]]:
    """The scene of a case, its frames, and the target's true position in each frame [m]; case: as in `run`."""
    duration_s, scene = float(case["duration_s"]), scene_of_body(case["body"])
    motion = motion_of(scene, Truth(pushes=PUSHES[case["pushes"]]), case["seed"], duration_s)
    scene = replace(scene, cameras=(), target=replace(scene.target, position_sd_m=0.0))
    network, rng = scene.network, np.random.default_rng([case["seed"], 7])
    times = np.arange(0.0, duration_s, INTERVAL_S)
    places = np.array([motion.at(float(time_s)) for time_s in times])
    seen = places[:, [network.index(node) for node in scene.measured_nodes]]
    seen = seen + case["sd_m"] * rng.normal(size=seen.shape)
    frames = frames_of(times, seen, scene.measured_nodes, case["sd_m"] * case["stated"])
    return scene, frames, list(places[:, network.index(scene.target.node)])
