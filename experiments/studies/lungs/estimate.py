"""Inner landmarks of a lung from those seen on its hull: by doing nothing, by a spline, by the filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from dynamics import NetworkError
from estimators import CovarianceError, MarkMeasurement, TissueFilter, normalised_error_squared
from estimators.process.target import target_map
from experiments.arrays import Floats
from experiments.studies.lungs.landmarks import Lung
from experiments.studies.lungs.model import LungConstants, lung_network
from experiments.studies.zoo.rivals import thin_plate_weights

SEEN: Mapping[str, int | None] = {"all of the hull": None, "ten": 10, "six": 6}
"""How many landmarks of each lung are seen."""


@dataclass(frozen=True, slots=True, eq=False)
class Inner:
    """Errors of the inner landmarks of a lung [m], (n_phases - 1, n_inner), the first phase left out: it is given.

    landmarks: places of the inner ones in the lung, (n_inner,)
    filtered, nees: of the filter, None where it could not; failure: why
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
    """Doing nothing and a thin-plate spline of the displacements, `seen` one of `SEEN`; not yet the filter."""
    marked = lung.seen(SEEN[seen])
    start, truth = lung.positions[0], lung.positions[1:, lung.inner]
    moved = lung.positions[1:, marked] - start[marked]
    spline = start[lung.inner] + np.einsum("ik,pkd->pid", thin_plate_weights(start[marked], start[lung.inner]), moved)
    nothing = np.linalg.norm(start[lung.inner] - truth, axis=2)
    return Inner(lung.name, seen, lung.inner, nothing, np.linalg.norm(spline - truth, axis=2))


def inner_landmarks(lung: Lung, seen: str, constants: LungConstants) -> Inner:
    """All methods on one lung, `seen` one of `SEEN`."""
    found = by_spline(lung, seen)
    try:
        means, covs = filtered(lung, lung.seen(SEEN[seen]), constants)
    except (NetworkError, CovarianceError, np.linalg.LinAlgError) as error:
        return replace(found, failure=f"not possible yet: {error}")
    errors = means[1:] - lung.positions[1:, lung.inner]
    # where a landmark was read is itself not exact
    read = covs[1:] + constants.reading_sd_m**2 * np.eye(3)
    nees = normalised_error_squared(errors.reshape(-1, 3), read.reshape(-1, 3, 3)).reshape(errors.shape[:2])
    return replace(found, filtered=np.linalg.norm(errors, axis=2), nees=nees)


def filtered(lung: Lung, marked: NDArray[np.int64], constants: LungConstants) -> tuple[Floats, Floats]:
    """Means [m], (n_phases, n_inner, 3), and covariances of the inner landmarks by the filter, one run for all."""
    network = lung_network(lung.positions[0], constants)
    names = [network.names[i] for i in marked]
    inner = [network.names[i] for i in lung.inner]
    tissue = TissueFilter(network, inner[0], names)
    maps = [target_map(network, name) for name in inner]
    cov = constants.reading_sd_m**2 * np.eye(3)
    means, covs = [], []
    for time_s, places in zip(lung.times_s, lung.positions, strict=True):
        tissue.predict(float(time_s))
        tissue.update([MarkMeasurement(name, places[i], cov) for name, i in zip(names, marked, strict=True)])
        found = [tissue.place_of(one) for one in maps]
        means.append([mean for mean, _ in found])
        covs.append([spread for _, spread in found])
    return np.array(means), np.array(covs)


def errors_table(found: Sequence[Inner]) -> pd.DataFrame:
    """One row for each inner landmark in each phase: errors by method [mm], NEES of the filter."""
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
