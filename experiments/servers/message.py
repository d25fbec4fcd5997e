"""JSON messages of a live run: first one for the scene, then one for each state.

Lengths are in mm, covariances in mm², times in s; missing numbers are null. For users: docs/live-stream.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.stats import chi2

from estimators import Guidance, Insertion
from experiments.arrays import Floats
from experiments.film.overlay import Overlay, within_95
from experiments.film.strokes import Colour
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.scene.outside import outside_of
from experiments.formats.scene.scene import Scene
from experiments.pipeline.events import pose_line
from experiments.pipeline.live.shown import Shown
from experiments.version import version

VERSION = 1
STALE_MS = 200
"""Age of the newest state above which a viewer shows it as stale [ms]; a requirement for needle guidance."""

N_FACES = 1500
"""Largest number of faces in a surface for viewers; choice: as many as a browser can shade for each state."""


BAND = (0.025, 0.975)
"""Quantiles of the 95 % interval of NIS."""


def scene_message(
    scene: Scene, source: str, picture_px: tuple[int, int] | None, plan: NeedlePlan | None
) -> dict[str, Any]:
    """The first message for viewers.

    picture_px: width and height of the picture; positions in states are in its pixels; None for a scene in space
    """
    network, surface = scene.network, None
    if network.dim == 3:
        outside = outside_of(scene, N_FACES)
        surface = {"corners_mm": (1e3 * outside.corners).round(2).tolist(), "faces": outside.faces.tolist()}
    return {
        "type": "scene",
        "version": VERSION,
        "softaim": version(),
        "source": source,
        "dim": network.dim,
        "nodes": [
            {"name": name, "fixed": bool(fixed), "drawn_mm": _mm(place)}
            for name, fixed, place in zip(network.names, network.fixed, network.positions, strict=True)
        ],
        "springs": network.springs.tolist(),
        "surface": surface,
        "marks": [
            {"node": m.node, "hue_deg": m.hue_deg, "diameter_mm": 1e3 * m.diameter_m, "measured": m.measured}
            for m in scene.marks
        ],
        "target": {"node": scene.target.node, "radius_mm": 1e3 * scene.target.radius_m},
        "picture_px": picture_px,
        "needle": None if plan is None else {"go_probability": plan.settings.go},
        "notes": [line for line in (pose_line(scene),) if line is not None],
        "stale_ms": STALE_MS,
    }


def state_message(
    shown: Shown,
    *,
    utc_s: float,
    memory_mb: float | None,
    overlay: Overlay | None = None,
    nodes_m: Floats | None = None,
    events: Sequence[Mapping[str, Any]] = (),
    recording: Mapping[str, Any] | None = None,
    paused: bool = False,
) -> dict[str, Any]:
    """The message with one state of the run.

    utc_s: time of the estimate, in seconds since 1970 UTC; memory_mb: memory of the process
    overlay: annotation of the picture; nodes_m: positions of all nodes [m], (n, dim)
    events: the last events, {"utc_s", "text"}; recording: {"folder", "frames"} while a recording is written
    paused: whether the run is paused
    """
    estimate, guidance = shown.estimate, shown.guidance
    cov = estimate.cov if estimate.cov is None or np.isfinite(estimate.cov).all() else None
    return {
        "type": "state",
        "version": VERSION,
        "time_s": estimate.time_s,
        "utc_s": utc_s,
        "from_frame": shown.step is not None,
        "status": str(estimate.status),
        "fault": shown.fault,
        "target_mm": _mm(estimate.mean),
        "cov_mm2": None if cov is None else (1e6 * cov).tolist(),
        "sigma_mm": None if cov is None else 1e3 * float(np.sqrt(np.linalg.eigvalsh(cov)[-1].clip(0.0))),
        "errors": shown.errors,
        "marks_used": estimate.marks_used,
        "nis": estimate.nis,
        "nis_band": nis_band(estimate.degrees),
        "poked": estimate.poked,
        "nodes_mm": None if nodes_m is None else [_mm(one) for one in nodes_m],
        "advice": None if guidance is None else _advice(guidance),
        "needle": None if shown.plan is None else _needle(shown.plan.insertion),
        "picture": None if overlay is None else _picture(overlay),
        "counters": _counters(shown, memory_mb),
        "events": [dict(one) for one in events],
        "recording": recording,
        "paused": paused,
    }


def _counters(shown: Shown, memory_mb: float | None) -> dict[str, Any]:
    """The loop's performance counters."""
    known = shown.counters
    return {
        **known.numbers,
        "latency_ms": known.latency_ms if known.frames else None,
        "latency_p99_ms": known.latencies.quantile_ms(0.99) if known.frames else None,
        "rate_hz": None if shown.interval_s is None else 1.0 / shown.interval_s,
        "memory_mb": memory_mb,
        "stages_ms": {stage: 1e3 * seconds for stage, seconds in known.stages_s.items()},
    }


def _mm(place_m: Floats) -> list[float] | None:
    return (1e3 * place_m).tolist() if np.isfinite(place_m).all() else None


def _needle(insertion: Insertion) -> dict[str, Any]:
    tip = insertion.entry + insertion.depth_m * insertion.axis
    return {"tip_mm": _mm(tip), "direction": insertion.axis.tolist(), "depth_mm": 1e3 * insertion.depth_m}


def _advice(guidance: Guidance) -> dict[str, Any]:
    return {
        "advice": str(guidance.advice),
        "reason": guidance.reason,
        "probability": guidance.probability,
        "arrival_s": guidance.arrival_s,
        "aim_mm": None if guidance.aim is None else _mm(guidance.aim),
        "lateral_mm": None if guidance.lateral_m is None else 1e3 * guidance.lateral_m,
        "depth_mm": None if guidance.depth_m is None else 1e3 * guidance.depth_m,
        "turn_deg": None if guidance.turn_rad is None else float(np.degrees(guidance.turn_rad)),
        "best_in_s": guidance.best_in_s,
        "best_probability": guidance.best_probability,
    }


def _picture(overlay: Overlay) -> dict[str, Any]:
    """The annotation in pixels of the picture; an ellipse is stated by its two semi-axes, which are vectors."""
    needle = overlay.needle
    return {
        "nodes_px": [_px(one) for one in overlay.nodes_px],
        "target_px": _px(overlay.target_px),
        "target_ellipse_px": _ellipse(overlay.target_cov_px2),
        "target_shape_px": overlay.target_shape_px.tolist(),
        "trusted": overlay.trusted,
        "status_colour": _colour(overlay.status_colour),
        "advice_colour": _colour(overlay.advice_colour) if overlay.advice else None,
        "notes": list(overlay.notes),
        "marks": [
            {
                "node": mark.name,
                "fate": str(mark.fate),
                "why": mark.why,
                "center_px": _px(mark.center_px),
                "expected_px": _px(mark.expected_px),
                "expected_ellipse_px": _ellipse(mark.expected_cov_px2),
                "shape_px": mark.shape_px.tolist(),
            }
            for mark in overlay.marks
        ],
        "needle": None
        if needle is None
        else {
            "shaft_px": [_px(one) for one in needle.shaft_px],
            "ahead_px": [_px(one) for one in needle.ahead_px],
            "aim_px": _px(needle.aim_px),
            "aim_ellipse_px": _ellipse(needle.aim_cov_px2),
        },
    }


def _px(place_px: Floats | None) -> list[float] | None:
    return None if place_px is None or not np.isfinite(place_px).all() else [float(x) for x in place_px]


def _ellipse(cov_px2: Floats | None) -> list[list[float]] | None:
    """Semi-axes of the 95 % ellipse, (2, 2), one in each row; None if there is no covariance."""
    shape = within_95(cov_px2)
    return None if shape is None else shape.T.tolist()


def _colour(colour: Colour) -> str:
    blue, green, red = colour
    return f"#{red:02x}{green:02x}{blue:02x}"


@lru_cache(maxsize=256)
def nis_band(degrees: int) -> tuple[float, float] | None:
    """The 95 % interval of NIS for this number of coordinates; None if the number is zero."""
    if not degrees:
        return None
    low, high = chi2.ppf(BAND, degrees)
    return float(low), float(high)
