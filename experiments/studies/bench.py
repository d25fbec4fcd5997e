"""Speed of parts of the program and of reference programs, measured in one run on the same input.

filter_step: one frame of the filter with three marks of the phantom. The reference is the interacting multiple model
filter of the package filterpy, with an unscented filter for each mode. It has the same states, noise, switching rates
and marks. It moves the sigma points one after the other, either in plain NumPy or in compiled code.
full_step: one frame of the filter that also assigns marks of equal colour to nodes. For `considered_ms`, ten constants
of the model are also uncertain.
bodies: one frame of the filter for a cubic grid with springs along edges and diagonals. One grid has 18 free nodes and
17 marks; the other has 48 free nodes and 40 marks.
advice: `path_ms_a_second` is the time that the filter takes to predict the target's path for one second, at 30 times.
`quick_path_ms` is the time to compute the path for 1.5 s from tables. `live_frame_ms` is the time of one live frame:
update and fit of the breathing model, a path from tables, and evaluation of 4 start times of the insertion.
`advise_plane_ms` and `advise_space_ms` are the times to evaluate 21 start times within 2 s for a known path.
`plan_500_paths_ms` is the time to plan 500 straight paths; `hit_probability_ms` is the time for one hit probability.
recording: times per frame for advice, tuning and smoothing, see `experiments.studies.bench_recording`.
detect: time to find four red marks in a picture of 1280x720: in the whole picture, near expected positions, or by
OpenCV's SimpleBlobDetector with its default settings.
scaling: a row for each mesh of a breast with 1,000 to 14,000 nodes and 40 marks, see `experiments.studies.scaling`.
loop_640x480: time from a frame in memory to the estimate. film_640x480: times to track a frame, to draw the estimate
into it, and to write it to a film.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial

import cv2
import filterpy.kalman as filterpy
import numpy as np
from scipy.linalg import expm

import vision
from dynamics import (
    HIDDEN,
    OUTER,
    MassSpringNetwork,
    build_network,
    four_mass_phantom,
    independent_uncertainty,
    parameters,
    plain_step,
)
from estimators import (
    AdviceSettings,
    AssociationFilter,
    Breathing,
    GaussianMixture,
    Guidance,
    Insertion,
    Lesion,
    MarkMeasurement,
    Plan,
    PlannedNeedle,
    PlannedTarget,
    Skin,
    TargetPath,
    TissueFilter,
    advise,
    ball,
    candidate_paths,
    hit_probability,
    path_by_tables,
    plan,
)
from estimators.core.moments import add_noise
from experiments.arrays import Floats
from experiments.engine.executor import results
from experiments.engine.workers import OWN_PROCESS
from experiments.formats.scenario import read_scenario
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import FILTER, Line
from experiments.simulation.film import film
from experiments.simulation.simulate import scene_of, true_motion
from experiments.studies.bench_recording import FRAME_S, film_640x480, median_ms, recording, resting_frames, seconds_of
from experiments.studies.estimation.trials import EXACTLY, Frames, passed
from experiments.studies.scaling import scaling
from vision.arrays import Image

Report = dict[str, dict[str, float] | list[dict[str, float]]]
Moments = tuple[Floats, Floats]

SUB_STEPS = 4
"""Number of Runge-Kutta steps per frame in the reference filter with plain NumPy."""


def bench(advance: Callable[[float], None] = lambda _share: None) -> Report:
    """Run all benchmarks; returns the figures of each benchmark by name, mostly median times [ms] and their ratios."""
    figures = results(lambda name: BENCHMARKS[name](), list(BENCHMARKS), OWN_PROCESS, advance)
    return dict(zip(BENCHMARKS, figures, strict=True))


def repeated_ms(work: Callable[[], object], repeats: int) -> float:
    """Median duration of `work` in `repeats` calls [ms], after one call that is not measured."""
    work()
    return 1e3 * float(np.median([seconds_of(work) for _ in range(repeats)]))


def filter_pair() -> tuple[Callable[[], Moments], Callable[[], Moments], Callable[[], Moments]]:
    """Three functions that estimate the target in a frame: our filter, filterpy in NumPy, filterpy in compiled code."""
    network = four_mass_phantom()
    tissue = TissueFilter(network, HIDDEN, OUTER, EXACTLY)
    frames = resting_frames(network, OUTER, 0.00414, 31)
    passed(tissue, frames[:-1])
    (time_s, marks), before = frames[-1], tissue.snapshot()
    process, own, target = tissue.process, tissue.filter, tissue.target
    means, covs, weights = own.means.copy(), own.covs.copy(), own.weights.copy()
    rows, by_state = np.vstack([process.node(node) for node in OUTER]), tissue.rows_of(target)
    z, rates = np.concatenate([mark.position for mark in marks]), expm(process.rates * FRAME_S)
    noises = np.zeros_like(covs)
    found = process.linearize(own.mean, FRAME_S)
    add_noise(noises, found, own.variances)
    points = filterpy.MerweScaledSigmaPoints(process.n, 1.0, 0.0, 0.0)
    velocity, force, n = process.parts["velocity"], process.parts["force"], network.n_state
    short_s = 1e-6  # so short that a force changes the speed but not the position
    pushes, fading = process.linearize(own.mean, short_s).matrix[velocity, force] / short_s, found.matrix.diagonal()[n:]

    def plain(x: Floats, dt: float) -> Floats:
        moving, last = x[:n].copy(), x[n:].copy()
        for _ in range(SUB_STEPS):
            moving[velocity] += dt / SUB_STEPS * (pushes @ last[: pushes.shape[1]])
            moving = plain_step(network, moving, dt / SUB_STEPS, 1)
            last *= fading ** (1.0 / SUB_STEPS)
        return np.concatenate([moving, last])

    def ours() -> Moments:
        tissue.restore(before)
        tissue.predict(time_s)
        tissue.update(marks)
        return tissue.place_of(target)

    def stock(motion: Callable[[Floats, float], Floats]) -> Moments:
        modes = []
        for mean, cov, noise in zip(means, covs, noises, strict=True):
            mode = filterpy.UnscentedKalmanFilter(process.n, len(z), FRAME_S, lambda x: rows @ x, motion, points)
            mode.x, mode.P, mode.Q, mode.R = mean, cov, noise, marks[0].cov[0, 0] * np.eye(len(z))
            modes.append(mode)
        theirs = filterpy.IMMEstimator(modes, weights.copy(), rates)
        theirs.predict()
        theirs.update(z)
        return by_state @ theirs.x + target.constant, by_state @ theirs.P @ by_state.T

    return ours, partial(stock, plain), partial(stock, process.moved)


def filter_step() -> dict[str, float]:
    """Times of our filter and of filterpy for one frame [ms], and their ratios."""
    ours, plain, compiled = filter_pair()
    ours_ms, plain_ms, compiled_ms = repeated_ms(ours, 300), repeated_ms(plain, 2), repeated_ms(compiled, 5)
    found = {"ours_ms": ours_ms, "filterpy_ms": plain_ms, "filterpy_compiled_ms": compiled_ms}
    return found | {"ratio": plain_ms / ours_ms, "ratio_compiled": compiled_ms / ours_ms}


def _frame_ms(tissue: TissueFilter, frames: Frames, groups: Sequence[Sequence[str]]) -> float:
    """Median time per frame [ms] of the filter together with the assignment of marks to the nodes in each group."""
    identity = AssociationFilter(tissue, groups)

    def step(time_s: float, marks: list[MarkMeasurement]) -> None:
        tissue.predict(time_s)
        identity.update(marks)

    return median_ms([seconds_of(partial(step, *frame)) for frame in frames])


def full_step(n_frames: int = 300) -> dict[str, float]:
    """Times per frame [ms] of a filter that also assigns marks to nodes, for exact and for uncertain constants."""
    network = four_mass_phantom()
    ten = independent_uncertainty(parameters(network, ("stiffness",)), 0.1)
    frames = resting_frames(network, OUTER, 0.00414, n_frames)
    return {
        "ours_ms": _frame_ms(TissueFilter(network, HIDDEN, OUTER, EXACTLY), frames, [OUTER]),
        "considered_ms": _frame_ms(TissueFilter(network, HIDDEN, OUTER, uncertainty=ten), frames, [OUTER]),
    }


def bodies(n_frames: int = 40) -> dict[str, float]:
    """Times per frame [ms] of the filter on two grids of nodes, with marks accurate to 0.5 mm."""
    return {f"grid_{n}_ms": _grid_ms(side, n_frames) for n, side in ((18, 3), (48, 4))}


def _grid_ms(side: int, n_frames: int) -> float:
    """Time per frame [ms] for a cube of 6 cm with `side` nodes along each edge; the lowest layer of nodes is fixed."""
    layer = np.arange(float(side))
    places = np.stack(np.meshgrid(layer, layer, layer, indexing="ij"), axis=-1).reshape(-1, 3)
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    springs = np.argwhere(np.triu((apart > 0.0) & (apart < 1.5)))
    step_m = 0.06 / (side - 1)
    names = [f"n{i}" for i in range(len(places))]
    network = build_network(
        names,
        step_m * places,
        [(int(i), int(j)) for i, j in springs],
        stiffness=4000.0 * step_m,
        damping=0.5,
        masses=0.2 / len(places),
        fixed=[name for name, place in zip(names, places, strict=True) if not place[2]],
        gravity=np.zeros(3),
    )
    inner = ((places > 0.0) & (places < side - 1.0)).all(axis=1)
    marked = [names[i] for i in np.flatnonzero(~(inner | network.fixed))]
    tissue = TissueFilter(network, names[int(np.argmax(inner))], marked)
    return _frame_ms(tissue, resting_frames(network, marked, 0.5e-3, n_frames), [])


def advice() -> dict[str, float]:
    """The times of the benchmark `advice` [ms]; the module's docstring explains each of them."""
    network = four_mass_phantom()
    tissue = TissueFilter(network, HIDDEN, OUTER, EXACTLY)
    passed(tissue, resting_frames(network, OUTER, 1e-3, 10))
    times = 9 * FRAME_S + FRAME_S * np.arange(1, 31, dtype=np.float64)
    report = {"path_ms_a_second": repeated_ms(lambda: tissue.predict_path(times), 20)}
    t = FRAME_S * np.arange(121, dtype=np.float64)
    tables, breathing, first = tissue.tables(46, FRAME_S), Breathing(2), 9 * FRAME_S
    for k in range(400):
        angle = 2.0 * np.pi * k * FRAME_S / 4.0
        breathing.update(k * FRAME_S, 0.01 * np.array([np.cos(angle), np.sin(angle)]), 1e-6 * np.eye(2))
    report["quick_path_ms"] = repeated_ms(lambda: path_by_tables(tables, tissue), 200)
    clock = iter(400 * FRAME_S + FRAME_S * np.arange(1000, dtype=np.float64))
    place = network.positions[network.index(HIDDEN)]
    ahead, disc = AdviceSettings(horizon_s=0.3), Lesion.ball(5e-3, 2)
    towards = Insertion(place + np.array([0.0, 0.025]), np.array([0.0, -1.0]), 0.05)

    def live_frame() -> Guidance:
        breathing.update(next(clock), place, 1e-6 * np.eye(2))
        breathing.breath()
        return advise(path_by_tables(tables, tissue), towards, disc, settings=ahead, now_s=first)

    report["live_frame_ms"] = repeated_ms(live_frame, 200)
    for dim, name in ((2, "plane"), (3, "space")):
        means = np.zeros((121, dim))
        means[:, 0] = 5e-3 * np.cos(3.0 * t)
        path = TargetPath(t, means, np.tile(1e-6 * np.eye(dim), (121, 1, 1)))
        insertion = Insertion(0.06 * np.eye(dim)[1], -np.eye(dim)[1], 0.1)
        lesion = Lesion.ball(5e-3, dim)
        report[f"advise_{name}_ms"] = repeated_ms(partial(advise, path, insertion, lesion), 200)
    target, lesion = GaussianMixture.gaussian(np.zeros(3), 1e-6 * np.diag([1.0, 2.0, 4.0])), Lesion.ball(5e-3, 3)
    axis = np.eye(3)[1]
    report["plan_500_paths_ms"] = repeated_ms(_planned(network), 20)
    report["hit_probability_ms"] = repeated_ms(lambda: hit_probability(target, target, axis, lesion), 500)
    return report


def _planned(network: MassSpringNetwork) -> Callable[[], Plan]:
    """A function that plans 500 paths: from 100 entries to five tip positions, with one vessel as an obstacle."""
    skin = Skin(np.array([-0.2, 0.33]), np.array([0.2, 0.33]), np.array([0.0, 1.0]), np.radians(60.0), 0.25)
    target = PlannedTarget(network.positions[network.index(HIDDEN)], np.diag([4e-6, 9e-6]), 5e-3)
    needle, vessel = PlannedNeedle(), ball("vessel", np.array([0.05, 0.27]), 0.01)

    def planned() -> Plan:
        entries, tips = candidate_paths(network, HIDDEN, target, needle, skin.entries(100), 5)
        return plan(network, HIDDEN, target, needle, skin, [vessel], entries=entries, tips=tips)

    return planned


def detect(n_frames: int = 60) -> dict[str, float]:
    """Times to find marks [ms]: in whole pictures, near expected positions, and with OpenCV's blob detector."""
    rng = np.random.default_rng(0)
    radius, names = 12.0, ("M1", "M2", "M3", "M4")
    homes = np.array([[300.0, 200.0], [950.0, 210.0], [310.0, 520.0], [940.0, 500.0]])
    outline, hue = vision.Outline(radius * np.eye(2), 0.05), vision.MarkHue(0.0)
    finder, blobs = vision.MarkFinder([hue]), cv2.SimpleBlobDetector.create()
    frames, where = [], []
    for k in range(n_frames):
        places = homes + 40.0 * np.array([np.cos(0.1 * k), np.sin(0.13 * k)])
        discs = [vision.Disc(place, (radius, radius), 0.0) for place in places]
        strays = vision.distractors(6, (1280, 720), rng, [0.0])
        frames.append(vision.draw_frame((1280, 720), [*strays, *discs], vision.Lighting(), rng))
        gate, own = 4.0 * np.eye(2), zip(names, places, strict=True)
        where.append([vision.Expected(name, at, gate, 0.0, outline) for name, at in own])

    def full(k: int) -> None:
        places = [one.center_px for one in where[k]]
        vision.detect_marks(frames[k], [hue], min_area_px=60.0, outlines=[outline], expected_px=places)

    def tracked(k: int) -> None:
        if len(finder.find(frames[k], where[k])) < len(names):
            raise RuntimeError(f"detect: expected four marks, missed {sorted(finder.missed or ())}")

    work: dict[str, Callable[[int], object]] = {
        "full_1280x720_ms": full,
        "tracked_ms": tracked,
        "blob_detector_ms": lambda k: blobs.detect(frames[k]),
    }
    medians = {name: median_ms([seconds_of(partial(one, k)) for k in range(n_frames)]) for name, one in work.items()}
    return medians | {"ratio": medians["blob_detector_ms"] / medians["full_1280x720_ms"]}


def loop_640x480(n_frames: int = 120) -> dict[str, float]:
    """Times for a frame of 640x480 in memory [ms]: detection, filter, all other work, and total."""
    scene, times_s, images = _filmed_webcam(n_frames)
    line, seconds = Line(scene, baseline=False), []
    for exposure_s, image in zip(times_s, images, strict=True):
        began = time.perf_counter()
        step = line.see(exposure_s, image)
        total_s, filter_s = time.perf_counter() - began, step.method_s[FILTER]
        seconds.append((step.detect_s, filter_s, total_s - step.detect_s - filter_s, total_s))
    names = ("detect_ms", "filter_ms", "rest_ms", "total_ms")
    return {name: median_ms(own) for name, own in zip(names, zip(*seconds, strict=True), strict=True)}


def _filmed_webcam(n_frames: int) -> tuple[Scene, list[float], list[Image]]:
    """Scene, exposure times [s] and pictures of the scenario `webcam`."""
    scenario = read_scenario("webcam").model_copy(update={"duration_s": n_frames * FRAME_S})
    rng = np.random.default_rng(scenario.seed)
    scene = scene_of(scenario)
    truth = true_motion(scene.network, scenario, rng)
    return scene, truth.times_s.tolist(), list(film(scenario, scene, truth, rng))


BENCHMARKS: dict[str, Callable[[], dict[str, float] | list[dict[str, float]]]] = {
    "filter_step": filter_step,
    "full_step": full_step,
    "bodies": bodies,
    "advice": advice,
    "recording": recording,
    "detect": detect,
    "scaling": scaling,
    "loop_640x480": loop_640x480,
    "film_640x480": lambda: film_640x480(*_filmed_webcam(60)),
}
"""Benchmarks by name."""
