"""Real messages of a small scene, by the code that makes them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from time import time
from typing import Any

import cv2
import numpy as np

from estimators import Advice, AdviceSettings, Guidance, Insertion, Lesion, Needle, Status, TargetEstimate
from experiments.film.overlay import Fate, MarkDrawn, NeedleDrawn, Overlay
from experiments.formats.needle_file import NeedlePlan, read_needle
from experiments.formats.scene.scene import read_scene
from experiments.pipeline.line import Step
from experiments.pipeline.live.shown import Counters, Shown
from experiments.servers.message import scene_message, state_message
from tests.experiments.in_space import breast

GIVEN = Path(__file__).parents[2]
SIZE_PX = (640, 480)


@cache
def scene() -> dict[str, Any]:
    """The scene's message."""
    read = read_scene(GIVEN / "good_scene.toml")
    plan = read_needle(GIVEN / "needle.toml", read.target.radius_m, read.network.dim)
    return scene_message(read, "phantom", SIZE_PX, plan)


def state(
    frames: int = 1, *, status: Status = Status.TRACKING, advice: Advice = Advice.GO, **changed: Any
) -> dict[str, Any]:
    """A state's message, known now; changed: keys that are to be other than they were made."""
    time_s, place = frames / 30, np.array([0.0, 0.2])
    estimate = TargetEstimate(time_s, place, np.diag([1e-6, 4e-6]), status, marks_used=1, nis=2.0, poked=0.1)
    guidance = Guidance(advice, "a hit is 92 % probable", arrival_s=time_s + 0.5, probability=0.925, aim=place)
    insertion = Insertion(np.array([0.0, 0.3]), np.array([0.0, -1.0]), 0.1, 0.05)
    made = state_message(
        shown(estimate, guidance, insertion, frames),
        utc_s=time(),
        memory_mb=300.0,
        overlay=overlay(),
        nodes_m=np.array([[-0.2, 0.2], [0.0, 0.2], [0.0, 0.0]]),
        events=[{"utc_s": 1.8e9, "text": "0.50 s: DROPPED: 2 frames"}],
    )
    return {**made, **changed}


def shown(estimate: TargetEstimate, guidance: Guidance | None, insertion: Insertion | None, frames: int = 1) -> Shown:
    """An estimate from a frame, with the advice on a needle here."""
    lesion = Lesion.ball(0.005, len(estimate.mean))
    plan = None if insertion is None else NeedlePlan(Needle(), insertion, lesion, AdviceSettings())
    counters, step = Counters(frames=frames, latency_ms=5.0), Step({}, (), 0.0, {})
    return Shown(estimate, estimate.time_s, None, step, guidance, plan, None, 1.0 / 30.0, counters, "")


@cache
def breast_scene() -> dict[str, Any]:
    """The message of a breast in space that another tracker sees, with a needle."""
    read = replace(breast(20), space_cameras=())
    insertion = Insertion(np.array([0.03, 0.02, 0.08]), np.array([0.0, 0.0, -1.0]), 0.1)
    plan = NeedlePlan(Needle(), insertion, Lesion.ball(read.target.radius_m, 3), AdviceSettings())
    return scene_message(read, "breast", None, plan)


def breast_state(frames: int = 1, *, moved_mm: float = 0.0, **changed: Any) -> dict[str, Any]:
    """A state of that breast, moved along x; known now."""
    network = breast(20).network
    nodes_m = network.positions + np.where(network.fixed[:, None], 0.0, [1e-3 * moved_mm, 0.0, 0.0])
    target = nodes_m[network.index(breast(20).target.node)]
    estimate = TargetEstimate(frames / 30, target, np.diag([1e-6, 4e-6, 9e-6]), Status.TRACKING, 12, nis=30.0)
    guidance = Guidance(
        Advice.GO, "a hit is 92 % probable", frames / 30 + 0.5, 0.925, aim=target, lateral_m=0.001, depth_m=0.02
    )
    insertion = Insertion(target + np.array([0.0, 0.0, 0.05]), np.array([0.0, 0.0, -1.0]), 0.1, 0.03)
    made = state_message(
        shown(estimate, guidance, insertion, frames),
        utc_s=time(),
        memory_mb=300.0,
        nodes_m=nodes_m,
    )
    return {**made, **changed}


def overlay() -> Overlay:
    """One mark found, one lost; a needle above the target; a node that is out of sight."""
    place = np.array([319.5, 231.5])
    shape = 12.0 * np.diag([1.0, -1.0])
    return Overlay(
        status="TRACKING",
        status_colour=(115, 158, 0),
        facts="",
        nodes_px=np.array([[159.5, 231.5], place, [np.nan, np.nan]]),
        names=("M1", "M2", "In1"),
        fixed=np.array([False, False, True]),
        springs=np.array([[0, 1], [1, 2]]),
        marks=(
            MarkDrawn("M1", 120.0, Fate.FOUND, shape, center_px=np.array([160.0, 231.0]), cov_px2=np.eye(2)),
            MarkDrawn("M2", 0.0, Fate.LOST, shape, expected_px=place, expected_cov_px2=np.eye(2), why="covered"),
        ),
        target_px=place,
        target_cov_px2=np.diag([0.64, 2.56]),
        target_shape_px=4.0 * np.diag([1.0, -1.0]),
        trusted=True,
        needle=NeedleDrawn(np.array([[320.0, 100.0], [320.0, 150.0]]), np.array([[320.0, 150.0], [320.0, 240.0]])),
    )


@cache
def picture(level: int = 120) -> bytes:
    """A plain picture as JPEG."""
    return cv2.imencode(".jpg", np.full((SIZE_PX[1], SIZE_PX[0], 3), level, np.uint8))[1].tobytes()
