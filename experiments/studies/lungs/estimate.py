"""Methods that estimate inner landmarks of a lung from landmarks on its hull: no motion, a spline, the filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from estimators import TissueFilter, normalised_error_squared
from experiments.arrays import Floats
from experiments.studies.estimation.trials import Frames, frames_of
from experiments.studies.lungs.landmarks import Lung
from experiments.studies.lungs.model import LungConstants, lung_network, node_name
from experiments.studies.zoo.references import thin_plate_weights
from experiments.studies.zoo.scores import Followed, followed

SEEN: Mapping[str, int | None] = {"all of the hull": None, "ten": 10, "six": 6}
"""Numbers of landmarks on the hull that the methods see, by name; None: all."""


@dataclass(frozen=True, slots=True, eq=False)
class Inner:
    """Errors of a lung's inner landmarks in all phases but the first [m], (n_phases - 1, n_inner).

    landmarks: indices of the inner landmarks in the lung, (n_inner,)
    nothing, spline, filtered: errors without motion, by the spline, and by the filter; nees: NEES of the filter
    If the filter failed, `filtered` and `nees` are None, and `failure` has the reason.
    """

    lung: str
    seen: str
    landmarks: NDArray[np.int64]
    nothing: Floats
    spline: Floats
    filtered: Floats | None = None
    nees: Floats | None = None
    failure: str = ""


def by_spline(lung: Lung, seen: str) -> Inner:
    """Errors without motion, and errors of a thin-plate spline; seen: one of `SEEN`."""
    marked = lung.seen(SEEN[seen])
    start, truth = lung.positions[0], lung.positions[1:, lung.inner]
    moved = lung.positions[1:, marked] - start[marked]
    spline = start[lung.inner] + thin_plate_weights(start[marked], start[lung.inner]) @ moved
    nothing = np.linalg.norm(start[lung.inner] - truth, axis=2)
    return Inner(lung.name, seen, lung.inner, nothing, np.linalg.norm(spline - truth, axis=2))


def inner_landmarks(lung: Lung, seen: str, constants: LungConstants) -> Inner:
    """Errors of all methods on one lung; seen: one of `SEEN`."""
    found, filtered = by_spline(lung, seen), followed_lung(lung, lung.seen(SEEN[seen]), constants)
    if filtered.failure:
        return replace(found, failure=f"not possible yet: {filtered.failure}")
    errors = filtered.means[1:] - lung.positions[1:, lung.inner]
    # the true position of a landmark, read by a person, has an error, too
    read = filtered.covs[1:] + constants.reading_sd_m**2 * np.eye(3)
    nees = normalised_error_squared(errors.reshape(-1, 3), read.reshape(-1, 3, 3)).reshape(errors.shape[:2])
    return replace(found, filtered=np.linalg.norm(errors, axis=2), nees=nees)


def lung_frames(lung: Lung, marked: NDArray[np.int64], sd_m: float) -> Frames:
    """Frames of a lung, one for each phase, with marks on the landmarks with the indices `marked`."""
    return frames_of(lung.times_s, lung.positions[:, marked], [node_name(i) for i in marked], sd_m)


def followed_lung(lung: Lung, marked: NDArray[np.int64], constants: LungConstants) -> Followed:
    """The filter's estimates of a lung's inner landmarks."""
    network = lung_network(lung.positions[0], constants)
    inner = [node_name(i) for i in lung.inner]
    begun = partial(TissueFilter, network, inner[0], [node_name(i) for i in marked])
    return followed(begun, network, inner, lung_frames(lung, marked, constants.reading_sd_m))


def errors_table(found: Sequence[Inner]) -> pd.DataFrame:
    """A row for each inner landmark in each phase: errors by method [mm], NEES of the filter."""
    parts = []
    for one in found:
        n_phases, n_inner = one.nothing.shape
        columns: dict[str, Any] = {
            "lung": one.lung,
            "seen": one.seen,
            "landmark": np.tile(one.landmarks, n_phases),
            "phase": np.repeat(np.arange(1, n_phases + 1), n_inner),
            "nothing_mm": 1e3 * one.nothing.ravel(),
            "spline_mm": 1e3 * one.spline.ravel(),
        }
        if one.filtered is not None and one.nees is not None:
            columns |= {"filter_mm": 1e3 * one.filtered.ravel(), "nees": one.nees.ravel()}
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)
