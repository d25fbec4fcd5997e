"""Speed of advice, of tuning, of smoothing, and of writing a film.

The benchmark `recording` uses frames of the phantom at rest, with three marks accurate to 1 mm.
advise_ms, advise_by_filter_ms: time of the advice for one frame. The advice evaluates 21 start times of the insertion
within 2 s. For `advise_ms`, the target's path is predicted from tables; for `advise_by_filter_ms`, by the filter.
tune_ms: time of `tune_strain` per frame; tune_passes: this time divided by the filter's time per frame
smooth_ms: time of `fixed_interval` per frame; smooth_ratio: this time divided by the filter's time per frame

The benchmark `film_640x480` draws estimates into a film. Processor times per frame on a busy machine were
4.1 ms for tracking, 3.4 ms for drawing and 3.7 ms for compression, in all 11.2 ms. If one of the four marks is missing
in every frame, the total is 32.5 ms, of which the search for this mark takes 25 ms.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from dynamics import HIDDEN, OUTER, MassSpringNetwork, four_mass_phantom
from estimators import (
    AdviceSettings,
    Insertion,
    Lesion,
    TissueFilter,
    fixed_interval,
    guide,
    path_near_rest,
    tune_strain,
)
from experiments.film.overlay import drawn
from experiments.film.views import overlay_of
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import Line
from experiments.studies.estimation.trials import EXACTLY, Frames, frames_of, passed
from vision import VideoWriter
from vision.arrays import Image

FRAME_S, MARK_SD_M = 1.0 / 30.0, 1e-3
N_ADVISED, N_BY_FILTER, N_TUNED, N_SMOOTHED = 30, 3, 50, 60


def seconds_of(work: Callable[[], object]) -> float:
    """Time that the function `work` takes [s]."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def median_ms(seconds: Sequence[float]) -> float:
    """Median [ms] of the durations after the first tenth; seconds: durations in the order of measurement [s]."""
    return 1e3 * float(np.median(seconds[len(seconds) // 10 :]))


def resting_frames(network: MassSpringNetwork, nodes: Sequence[str], sd_m: float, n_frames: int) -> Frames:
    """Frames with noisy marks on a body at rest; sd_m: standard deviation of the noise on each axis [m]."""
    at = network.positions[[network.index(node) for node in nodes]]
    places = at + np.random.default_rng(0).normal(0.0, sd_m, (n_frames, *at.shape))
    return frames_of(FRAME_S * np.arange(n_frames), places, nodes, sd_m)


def recording() -> dict[str, float]:
    """Figures of the benchmark `recording`; the module's docstring explains them."""
    frames = resting_frames(four_mass_phantom(), OUTER, MARK_SD_M, N_SMOOTHED)
    return advised(frames) | tuned(frames[:N_TUNED]) | smoothed(frames)


def _filter() -> TissueFilter:
    return TissueFilter(four_mass_phantom(), HIDDEN, OUTER, EXACTLY)


def _pass_s(frames: Frames) -> float:
    """Time that the filter takes for these frames [s]."""
    return seconds_of(partial(passed, _filter(), frames))


def advised(frames: Frames) -> dict[str, float]:
    """Median times of the advice for one frame [ms], with a path from tables and with a path from the filter."""
    tissue, network = _filter(), four_mass_phantom()
    place = network.positions[network.index(HIDDEN)]
    towards = Insertion(place + np.array([0.0, 0.03]), np.array([0.0, -1.0]), 0.1)
    tables, settings = tissue.tables(82, FRAME_S), AdviceSettings(horizon_s=2.0)
    asked = partial(guide, insertion=towards, lesion=Lesion.ball(5e-3, 2), settings=settings)
    fast, slow = [], []
    for left, (time_s, marks) in zip(range(len(frames), 0, -1), frames, strict=True):
        tissue.predict(time_s)
        estimate = tissue.update(marks)
        if left <= N_ADVISED:
            fast.append(seconds_of(partial(asked, tissue, estimate, path_at=partial(path_near_rest, tables, tissue))))
        if left <= N_BY_FILTER:
            slow.append(seconds_of(partial(asked, tissue, estimate)))
    by_tables, by_filter = 1e3 * float(np.median(fast)), 1e3 * float(np.median(slow))
    return {"advise_ms": by_tables, "advise_by_filter_ms": by_filter, "advise_ratio": by_filter / by_tables}


def tuned(frames: Frames) -> dict[str, float]:
    """Time of `tune_strain` per frame [ms], and its ratio to the filter's time per frame [1]."""
    pass_s = min(_pass_s(frames), _pass_s(frames))
    took_s = seconds_of(partial(tune_strain, four_mass_phantom(), frames, OUTER, HIDDEN))
    return {"tune_ms": 1e3 * took_s / len(frames), "tune_passes": took_s / pass_s}


def smoothed(frames: Frames) -> dict[str, float]:
    """Time of smoothing per frame [ms], and its ratio to the filter's time per frame [1]."""
    fixed_interval(_filter(), frames[:3])
    pass_s, took_s = _pass_s(frames), seconds_of(partial(fixed_interval, _filter(), frames))
    return {"smooth_ms": 1e3 * took_s / len(frames), "smooth_ratio": took_s / pass_s}


def film_640x480(scene: Scene, times_s: Sequence[float], images: Sequence[Image]) -> dict[str, float]:
    """Median times per frame [ms] of tracking, drawing and compression, and of all three together."""
    line, camera, seconds = Line(scene, explain=True), scene.cameras[0], []
    with TemporaryDirectory() as folder, VideoWriter(Path(folder) / "film.avi", camera.size_px, 30.0) as writer:
        for time_s, image in zip(times_s, images, strict=True):
            marks = [time.perf_counter()]
            step = line.see(time_s, image)
            marks.append(time.perf_counter())
            picture = drawn(image, overlay_of(line, step, camera))
            marks.append(time.perf_counter())
            writer.write(picture)
            marks.append(time.perf_counter())
            seconds.append([*np.diff(marks), marks[-1] - marks[0]])
    track, draw, encode, total = 1e3 * np.median(seconds[len(seconds) // 10 :], axis=0)
    return {"track_ms": float(track), "draw_ms": float(draw), "encode_ms": float(encode), "total_ms": float(total)}
