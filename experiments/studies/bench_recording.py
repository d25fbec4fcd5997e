"""How fast what goes through whole recordings is: advice on a needle, the level of the discrepancy, the smoother.

One recording of the phantom at rest, three marks to 1 mm, 30 frames/s; figures of `softaim bench`, row `recording`.
advise: a frame's advice, 21 starts over 2 s, from a path by tables, and from one by `TissueFilter.predict_path`.
tune: `tune_strain` on 50 frames, for each frame of them, and how many passes of the filter that is worth.
smooth: `fixed_interval`, for each frame; ratio: by the filter alone on the same frames.
"""

from __future__ import annotations

import time
from functools import partial

import numpy as np

from dynamics import HIDDEN, OUTER, four_mass_phantom
from estimators import (
    AdviceSettings,
    Insertion,
    Lesion,
    MarkMeasurement,
    TissueFilter,
    fixed_interval,
    guide,
    path_near_rest,
    tune_strain,
)
from experiments.studies.estimation.trials import EXACTLY

FRAME_S, MARK_SD_M = 1.0 / 30.0, 1e-3
N_ADVISED, N_BY_FILTER, N_TUNED, N_SMOOTHED = 30, 3, 50, 60

Frames = list[tuple[float, list[MarkMeasurement]]]


def recording() -> dict[str, float]:
    """All figures of this page; medians or totals by frames, in ms."""
    frames = resting_frames(N_SMOOTHED)
    return advised(frames) | tuned(frames[:N_TUNED]) | smoothed(frames)


def resting_frames(n_frames: int) -> Frames:
    """Marks of the phantom at rest."""
    rng, network = np.random.default_rng(0), four_mass_phantom()
    at = {node: network.positions[network.index(node)] for node in OUTER}
    cov = MARK_SD_M**2 * np.eye(2)
    return [
        (k * FRAME_S, [MarkMeasurement(node, at[node] + rng.normal(0.0, MARK_SD_M, 2), cov) for node in OUTER])
        for k in range(n_frames)
    ]


def _filter() -> TissueFilter:
    return TissueFilter(four_mass_phantom(), HIDDEN, OUTER, EXACTLY)


def _passed(frames: Frames) -> float:
    """Seconds of the filter's way through frames."""
    tissue, began = _filter(), time.perf_counter()
    for time_s, marks in frames:
        tissue.predict(time_s)
        tissue.update(marks)
    return time.perf_counter() - began


def advised(frames: Frames) -> dict[str, float]:
    """Advice at each frame, by tables and by the filter."""
    tissue, network = _filter(), four_mass_phantom()
    place = network.positions[network.index(HIDDEN)]
    towards = Insertion(place + np.array([0.0, 0.03]), np.array([0.0, -1.0]), 0.1)
    tables, settings = tissue.tables(82, FRAME_S), AdviceSettings(horizon_s=2.0)
    asked = partial(guide, insertion=towards, lesion=Lesion.ball(5e-3, 2), settings=settings)
    fast, slow = [], []
    for k, (time_s, marks) in enumerate(frames):
        tissue.predict(time_s)
        estimate = tissue.update(marks)
        if k < len(frames) - N_ADVISED:
            continue
        began = time.perf_counter()
        asked(tissue, estimate, path_at=partial(path_near_rest, tables, tissue))
        fast.append(time.perf_counter() - began)
        if k < len(frames) - N_BY_FILTER:
            continue
        began = time.perf_counter()
        asked(tissue, estimate)
        slow.append(time.perf_counter() - began)
    by_tables, by_filter = 1e3 * float(np.median(fast)), 1e3 * float(np.median(slow))
    return {"advise_ms": by_tables, "advise_by_filter_ms": by_filter, "advise_ratio": by_filter / by_tables}


def tuned(frames: Frames) -> dict[str, float]:
    """The level of the discrepancy by the frames, and what a pass through them takes in the same run."""
    pass_s, began = min(_passed(frames), _passed(frames)), time.perf_counter()
    tune_strain(four_mass_phantom(), frames, OUTER, HIDDEN)
    took_s = time.perf_counter() - began
    return {"tune_ms": 1e3 * took_s / len(frames), "tune_passes": took_s / pass_s}


def smoothed(frames: Frames) -> dict[str, float]:
    """The smoother's way through the frames and back, and the filter's alone."""
    fixed_interval(_filter(), frames[:3])
    pass_s, began = _passed(frames), time.perf_counter()
    fixed_interval(_filter(), frames)
    took_s = time.perf_counter() - began
    return {"smooth_ms": 1e3 * took_s / len(frames), "smooth_ratio": took_s / pass_s}
