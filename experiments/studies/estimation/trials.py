"""Runs without pictures: a scenario's true motion, noisy marks, and the errors of the paper's method and the filter.

SciPy's RK45 computes the truth (`experiments.simulation.simulate`); a folder stores it, because many runs use it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dynamics import HIDDEN, OUTER, MassSpringNetwork, ParameterUncertainty, four_mass_phantom
from estimators import FilterSettings, MarkMeasurement, OpenLoop, TargetEstimate, TissueFilter, normalised_error_squared
from experiments.arrays import Floats
from experiments.formats.scenario import read_scenario
from experiments.simulation.seen_marks import outliers
from experiments.simulation.simulate import EXACT, kept_motion

Frames = list[tuple[float, list[MarkMeasurement]]]

KNOTS_PER_S = 120
"""Sampling rate of the truth [1/s]; frame rates must divide it."""

EXACTLY = FilterSettings(discrepancy=EXACT)
"""Filter settings for a model that equals the true phantom. The settings assume only small errors of the model."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One run: a shipped scenario with changes.

    mark_sd_m: sd of the marks' noise on each axis [m]; strength: factor of the short forces; lost: share of lost marks
    outliers: share of marks that are 30 to 150 mm from their true positions, in any direction
    """

    scenario: str
    seed: int
    duration_s: float = 20.0
    frames_per_s: int = 30
    mark_sd_m: float = 0.00414
    strength: float = 1.0
    lost: float = 0.0
    outliers: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """The model of the tissue that the methods use."""

    network: MassSpringNetwork = field(default_factory=four_mass_phantom)
    uncertainty: ParameterUncertainty | None = None
    settings: FilterSettings = EXACTLY


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """The result of a run.

    open_loop, filtered: errors of the hidden mass [m], (n_frames,); nees: the filter's NEES
    turned: whether a spring turned over, see the function `turned`
    """

    times_s: Floats
    open_loop: Floats
    filtered: Floats
    nees: Floats
    status: tuple[str, ...]
    turned: bool


def frames_of(times_s: Iterable[float], places: Iterable[Floats], names: Sequence[str], sd_m: float) -> Frames:
    """Frames of marks with these names and positions [m], (n_frames, n_names, dim); sd_m: sd of a mark per axis [m]."""
    return [
        (float(time_s), [MarkMeasurement(name, z, sd_m**2 * np.eye(len(z))) for name, z in zip(names, at, strict=True)])
        for time_s, at in zip(times_s, places, strict=True)
    ]


def truth(trial: Trial, cache: Path) -> Floats:
    """True positions of free nodes [m], (n_times, n_free, dim), `KNOTS_PER_S` per second; kept in folder `cache`."""
    change: dict[str, object] = {
        "seed": trial.seed,
        "duration_s": trial.duration_s,
        "frame_interval_s": 1.0 / KNOTS_PER_S,
    }
    scenario = read_scenario(trial.scenario)
    if scenario.pokes is not None:
        pokes = {"acceleration_m_s2": trial.strength * scenario.pokes.acceleration_m_s2}
        change["pokes"] = scenario.pokes.model_copy(update=pokes)
    scenario = scenario.model_copy(update=change)
    path = cache / f"{trial.scenario}_{trial.seed}_{trial.duration_s:g}_{trial.strength:g}.npy"
    return kept_motion(path, four_mass_phantom(), scenario, np.random.default_rng(trial.seed)).positions


def seen(trial: Trial, cache: Path, rng: np.random.Generator, nodes: Sequence[str] = OUTER) -> tuple[Frames, Floats]:
    """Frames with marks of these nodes, and the hidden mass's true positions [m], (n_frames, dim)."""
    positions = truth(trial, cache)
    step = KNOTS_PER_S // trial.frames_per_s
    network = four_mass_phantom()
    places = {node: network.coordinates(node).start // network.dim for node in (*nodes, HIDDEN)}
    cov = trial.mark_sd_m**2 * np.eye(network.dim)
    frames: Frames = []
    for k, now in enumerate(positions[::step]):
        noisy = now + rng.normal(0.0, trial.mark_sd_m, now.shape)
        kept = rng.random(len(nodes)) >= trial.lost
        if trial.outliers:
            noisy = noisy + outliers(noisy.shape, trial.outliers, rng)
        marks = [
            MarkMeasurement(node, noisy[places[node]], cov) for node, there in zip(nodes, kept, strict=True) if there
        ]
        frames.append((k * step / KNOTS_PER_S, marks))
    return frames, positions[::step, places[HIDDEN]]


def passed(tissue: TissueFilter, frames: Frames) -> list[TargetEstimate]:
    """The filter's estimates, frame by frame."""
    estimates = []
    for time_s, marks in frames:
        tissue.predict(time_s)
        estimates.append(tissue.update(marks))
    return estimates


def run(trial: Trial, model: Model, cache: Path) -> Outcome:
    """Run the paper's method and the filter on the same marks."""
    rng = np.random.default_rng([trial.seed, trial.frames_per_s, round(1e6 * trial.mark_sd_m)])
    frames, hidden = seen(trial, cache, rng)
    open_loop = OpenLoop(model.network, HIDDEN)
    paper = np.array([open_loop.update(time_s, marks).mean for time_s, marks in frames])
    tissue = TissueFilter(model.network, HIDDEN, OUTER, model.settings, uncertainty=model.uncertainty)
    ours = passed(tissue, frames)
    errors = np.array([estimate.mean for estimate in ours]) - hidden
    return Outcome(
        np.array([time_s for time_s, _ in frames]),
        np.linalg.norm(paper - hidden, axis=1),
        np.linalg.norm(errors, axis=1),
        normalised_error_squared(errors, np.array([estimate.cov for estimate in ours])),
        tuple(estimate.status.value for estimate in ours),
        turned(truth(trial, cache)),
    )


def turned(positions: Floats) -> bool:
    """Whether a spring ever turns by more than 90° from rest; positions: of free nodes [m], (n_times, n_free, dim)."""
    network = four_mass_phantom()
    everywhere = np.broadcast_to(network.positions, (len(positions), *network.positions.shape)).copy()
    everywhere[:, network.free] = positions
    i, j = network.springs.T
    along = (everywhere[:, j] - everywhere[:, i]) * (network.positions[j] - network.positions[i])
    return bool((along.sum(axis=2) < 0.0).any())
