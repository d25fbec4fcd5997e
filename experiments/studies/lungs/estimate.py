"""Inner landmarks of a lung, estimated from visible landmarks on its hull by the filter, a spline, or no motion."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from estimators import TissueFilter, normalised_error_squared
from experiments.studies.estimation.trials import Frames, frames_of
from experiments.studies.lungs.landmarks import Lung
from experiments.studies.lungs.model import LungConstants, lung_network, node_name
from experiments.studies.zoo.references import thin_plate_weights
from experiments.studies.zoo.scores import Followed, followed

SEEN: Mapping[str, int | None] = {"all of the hull": None, "ten": 10, "six": 6}
"""Numbers of visible landmarks in each lung; None for all."""


def inner_errors(lung: Lung, seen: str, constants: LungConstants) -> pd.DataFrame:
    """A row for each inner landmark in each phase after the first: errors by method [mm], NEES of the filter.

    seen: one of `SEEN`. Raises RuntimeError if the filter fails.
    """
    marked = lung.seen(SEEN[seen])
    start, truth = lung.positions[0], lung.positions[1:, lung.inner]
    moved = lung.positions[1:, marked] - start[marked]
    found = followed_lung(lung, marked, constants)
    if found.failure:
        raise RuntimeError(found.failure)
    places = {
        "nothing": np.broadcast_to(start[lung.inner], truth.shape),
        "spline": start[lung.inner] + thin_plate_weights(start[marked], start[lung.inner]) @ moved,
        "filter": found.means[1:],
    }
    # the position with which it is compared, read by a person, has an error, too
    read = found.covs[1:] + constants.reading_sd_m**2 * np.eye(3)
    nees = normalised_error_squared((found.means[1:] - truth).reshape(-1, 3), read.reshape(-1, 3, 3))
    phases = np.repeat(np.arange(1, len(truth) + 1), len(lung.inner))
    errors = {f"{name}_mm": 1e3 * np.linalg.norm(at - truth, axis=2).ravel() for name, at in places.items()}
    return pd.DataFrame({"lung": lung.name, "seen": seen, "phase": phases, **errors, "nees": nees})


def lung_frames(lung: Lung, marked: NDArray[np.int64], sd_m: float) -> Frames:
    """Frames at the times of a lung's phases [s], each with the marks of these landmarks."""
    return frames_of(lung.times_s, lung.positions[:, marked], [node_name(i) for i in marked], sd_m)


def followed_lung(lung: Lung, marked: NDArray[np.int64], constants: LungConstants) -> Followed:
    """Estimates of all inner landmarks of a lung, from one run of the filter."""
    network = lung_network(lung.positions[0], constants)
    inner = [node_name(i) for i in lung.inner]
    begun = partial(TissueFilter, network, inner[0], [node_name(i) for i in marked])
    return followed(begun, network, inner, lung_frames(lung, marked, constants.reading_sd_m))
