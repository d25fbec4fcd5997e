"""Recordings of the study: marks of a body, and the true positions of its hidden points."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from dynamics import HIDDEN, OUTER, MassSpringNetwork, ParameterUncertainty
from estimators import FilterSettings, MarkMeasurement
from estimators.process.target import TargetPoint
from experiments.arrays import Floats
from experiments.studies.estimation.study import perturbed
from experiments.studies.estimation.trials import Model, Trial, seen
from experiments.studies.honesty import recorded
from experiments.studies.lungs import READING_SD_M, lung_frames, lung_network, node_name, read_lungs
from experiments.studies.zoo.case import Case, assumed, measured


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Input of a filter, and the true positions of its targets.

    targets: hidden points; frames: times [s] and marks
    truth: positions of the targets [m], (n_frames, n_targets, dim); read_sd_m: sd of their error on each axis [m]
    """

    network: MassSpringNetwork
    marked: Sequence[str]
    targets: Sequence[str | TargetPoint]
    frames: Sequence[tuple[float, Sequence[MarkMeasurement]]]
    truth: Floats
    settings: FilterSettings = field(default_factory=FilterSettings)
    uncertainty: ParameterUncertainty | None = None
    read_sd_m: float = 0.0


def _zoo(name: str, constants: str, seconds: float, first: int = 0) -> Callable[[int], Recording]:
    """Function that makes a recording of this body of the zoo from a seed; first: number of the first frame to use."""

    def made(seed: int) -> Recording:
        case = Case(name, seed, constants, length_s=seconds)
        body, model = case.motion, assumed(case.motion, case)
        frames = measured(body, body.marked, seed)[first:]
        truth = body.positions[first:, [body.network.index(node) for node in body.hidden]]
        return Recording(model.network, body.marked, body.hidden, frames, truth, model.settings, model.uncertainty)

    return made


def _honest(body: str, sd_mm: float, seconds: float, stated: float = 1.0) -> Callable[[int], Recording]:
    def made(seed: int) -> Recording:
        case = {"body": body, "pushes": "both", "seed": seed, "sd_m": 1e-3 * sd_mm, "stated": stated}
        scene, frames, truth = recorded({**case, "duration_s": seconds})
        places = np.array(truth)[:, None]
        return Recording(scene.network, scene.measured_nodes, [scene.target.point], frames, places)

    return made


def _four_masses(outliers: float, model: Callable[[int], Model], seconds: float) -> Callable[[int], Recording]:
    def made(seed: int) -> Recording:
        own, rng = model(seed), np.random.default_rng([seed, 1])
        with tempfile.TemporaryDirectory() as cache:
            frames, hidden = seen(Trial("poked", seed, seconds, outliers=outliers), Path(cache), rng)
        return Recording(own.network, OUTER, [HIDDEN], frames, hidden[:, None], uncertainty=own.uncertainty)

    return made


def lung(folder: Path) -> Recording:
    """Recording of the first lung in the folder, with ten landmarks on its hull as marks."""
    one = read_lungs(folder)[0]
    marked = one.seen(10)
    seen, hidden = ([node_name(i) for i in landmarks] for landmarks in (marked, one.inner))
    network, truth = lung_network(one.positions[0]), one.positions[:, one.inner]
    return Recording(network, seen, hidden, lung_frames(one, marked), truth, read_sd_m=READING_SD_M)


BODIES: Mapping[str, Callable[[int], Recording]] = {
    "phantom": _zoo("phantom", "true", 3.0),
    "phantom, constants wrong": _zoo("phantom", "wrong", 3.0),
    "four masses, outliers": _four_masses(0.03, lambda _seed: Model(), 5.0),
    "four masses, known to 10 %": _four_masses(0.0, partial(perturbed, known=True), 5.0),
    "four masses, marks to 10 mm": _honest("four masses", 10.0, 5.0),
    "four masses, noise of 10 mm stated as 3.3 mm": _honest("four masses", 10.0, 5.0, 1.0 / 3.0),
    "four masses, noise of 1 mm stated as 10 mm": _honest("four masses", 1.0, 5.0, 10.0),
    "breast, marks to 1 mm": _honest("breast", 1.0, 2.0),
    "cable, slow": _zoo("cable-slow", "true", 2.0),
    "cable, fast": _zoo("cable-fast", "true", 1.5),
    "cable, first seen in motion": _zoo("cable-fast", "true", 1.5, first=15),
    "block of 27": _zoo("block27", "true", 1.5),
    "cloth": _zoo("sheet", "true", 1.5),
    "floating block": _zoo("floating", "true", 1.5),
}
"""Functions that create a recording from a seed, by the name of the body."""

LUNG = "lung"
"""Name of the lung among the bodies; its recording comes from landmark tables, and is the same for all seeds."""


@lru_cache(maxsize=1)
def recording(body: str, seed: int, lungs: str) -> Recording:
    """The recording of a body; body: `LUNG` or one of `BODIES`; lungs: folder of landmark tables."""
    return lung(Path(lungs)) if body == LUNG else BODIES[body](seed)
