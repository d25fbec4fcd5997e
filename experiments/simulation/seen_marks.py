"""Simulated recordings without a film: noisy marks of a true motion, with missing marks and outliers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.arrays import Floats
from experiments.formats.marks.rows import MarkRow
from experiments.formats.recording import Recording
from experiments.formats.recording import Truth as TruthTable
from experiments.formats.scenario import SeenMarks
from experiments.formats.scene.reference import reference_places
from experiments.formats.scene.scene import Scene

MISPLACED_M = (0.03, 0.15)
"""Smallest and largest distance of an outlier from the true position [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True motion: positions of the network's free nodes [m], (n, n_free, dim), at the times `times_s` [s], (n,)."""

    times_s: Floats
    positions: Floats


def misplaced(shape: tuple[int, ...], marks: SeenMarks, rng: np.random.Generator) -> tuple[NDArray[np.bool_], Floats]:
    """Whether each mark is missing, (n_frames, n_marks), and the errors of outliers [m], (n_frames, n_marks, dim)."""
    return rng.random(shape[:2]) < marks.lost, outliers(shape, marks.outliers, rng)


def outliers(shape: tuple[int, ...], share: float, rng: np.random.Generator) -> Floats:
    """Errors of marks [m]: a random share of the marks are outliers in random directions; other errors are zero."""
    ways = rng.normal(size=shape)
    ways *= rng.uniform(*MISPLACED_M, (*shape[:-1], 1)) / np.linalg.norm(ways, axis=-1, keepdims=True)
    return np.where(rng.random((*shape[:-1], 1)) < share, ways, 0.0)


def seen_marks(scene: Scene, motion: Truth, marks: SeenMarks, rng: np.random.Generator) -> Recording:
    """Recording of noisy marks of a true motion, with the target's true positions. No reference mark is missing.

    If the generator is the same, sd_mm only scales the noise, and a larger share of missing marks includes the marks
    that are missing at a smaller share.
    """
    network = scene.network
    column = {network.names[node]: k for k, node in enumerate(network.free)}
    places = motion.positions[:, [column[node] for node in scene.measured_nodes]]
    sd_m = 1e-3 * marks.sd_mm
    noisy = places + sd_m * rng.normal(size=places.shape)
    lost, aside = misplaced(places.shape, marks, rng)
    noisy = noisy + aside
    still = reference_places(scene.reference, network)
    stood = np.array(list(still.values())).reshape(-1, network.dim)
    stood = stood + sd_m * rng.normal(size=(len(places), *stood.shape))
    rows = tuple(
        (
            *(MarkRow(node, noisy[k, m], sd_m) for m, node in enumerate(scene.measured_nodes) if not lost[k, m]),
            *(MarkRow(name, stood[k, m], sd_m) for m, name in enumerate(still)),
        )
        for k in range(len(places))
    )
    target = scene.target.node
    truth = TruthTable({target: motion.times_s}, {target: motion.positions[:, column[target]]})
    return Recording(Path(), scene, motion.times_s, None, rows, truth, ())
