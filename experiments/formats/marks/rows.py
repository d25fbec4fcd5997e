"""Marks from another tracker, repeated ones, and the order of covariance entries: xx, xy, yy, xz, yz, zz."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from experiments.arrays import Floats
from experiments.formats.tables import Table
from vision import FrozenValues, SourceEvent

AXES = ("x_mm", "y_mm", "z_mm")

FARTHEST_MM, FINEST_MM = 1e6, 1e-6
"""Largest coordinate and least standard deviation of a mark [mm]: a kilometre and a nanometre."""

Coordinate = Annotated[float, Field(ge=-FARTHEST_MM, le=FARTHEST_MM)]

LEAST_SHARE = 1e-9
"""Least ratio of the smallest to the largest variance of a definite covariance [1]; numerical: rounding in files."""


@dataclass(frozen=True, slots=True, eq=False)
class MarkRow:
    """A mark from another tracker.

    position_m: position [m], (dim,)
    full_cov: covariance of the position [m²], (dim, dim); None if the file has none
    sd_m: standard deviation on each axis [m]; if there is a `full_cov`, the root of its mean variance
    """

    node: str
    position_m: Floats
    sd_m: float
    full_cov: Floats | None = None

    @classmethod
    def of_cov(cls, node: str, position_m: Floats, cov: Floats) -> MarkRow:
        """A mark with a full covariance [m²], (dim, dim)."""
        return cls(node, position_m, float(np.sqrt(np.trace(cov) / len(cov))), cov)

    @property
    def cov(self) -> Floats:
        """Covariance of the mark [m²], (dim, dim)."""
        return self.sd_m**2 * np.eye(len(self.position_m)) if self.full_cov is None else self.full_cov


def _entries(dim: int) -> list[tuple[int, int]]:
    return [(a, b) for b in range(dim) for a in range(b + 1)]


def cov_names(dim: int) -> list[str]:
    """The entries of a covariance, in order: xx, xy, yy, and in space xz, yz, zz."""
    return ["xyz"[a] + "xyz"[b] for a, b in _entries(dim)]


def cov_columns(dim: int) -> list[str]:
    """Names of the columns with the entries of a covariance."""
    return [f"cov_{name}_mm2" for name in cov_names(dim)]


def cov_of(entries_mm2: ArrayLike, dim: int) -> Floats:
    """Covariances [m²], (n, dim, dim), from their entries [mm²], (n, n_entries), in the order of `cov_names`."""
    entries = 1e-6 * np.asarray(entries_mm2, dtype=float)
    covs = np.empty((len(entries), dim, dim))
    for k, (a, b) in enumerate(_entries(dim)):
        covs[:, a, b] = covs[:, b, a] = entries[:, k]
    return covs


def cov_entries_mm2(cov: Floats) -> list[float]:
    """The entries of a covariance [m²], (dim, dim), converted to mm², in the order of `cov_names`."""
    return [float(1e6 * cov[a, b]) for a, b in _entries(len(cov))]


def are_definite(covs: Floats) -> NDArray[np.bool_]:
    """Whether each covariance [m²] is positive definite, with a tolerance for rounding in files, (n,).

    Variances below the square of FINEST_MM count as 0.
    """
    if not len(covs):
        return np.empty(0, dtype=bool)
    variances = np.linalg.eigvalsh(covs)
    # the limit allows for rounding, because a recording has covariances in place of standard deviations
    large = covs.diagonal(0, 1, 2).min(axis=1) >= (1.0 - LEAST_SHARE) * (1e-3 * FINEST_MM) ** 2
    found: NDArray[np.bool_] = large & (variances[:, 0] > LEAST_SHARE * variances[:, -1])
    return found


def check_limits(table: Table) -> Table:
    """The table; raises InputError for a coordinate, standard deviation or covariance beyond the limits of a mark."""
    for column, values in table.numbers.items():
        if column in AXES:
            table.check(column, np.abs(values) <= FARTHEST_MM, "-1e6 to 1e6")
        elif column == "sd_mm":
            table.check(column, (values >= FINEST_MM) & (values <= FARTHEST_MM), "1e-6 to 1e6")
        elif column.startswith("cov_"):
            table.check(column, np.abs(values) <= FARTHEST_MM**2, "-1e12 to 1e12")
    return table


def values_of(marks: Iterable[MarkRow]) -> dict[str, tuple[float, ...]]:
    """Positions of a frame's marks by node [m], for a comparison with other frames."""
    return {mark.node: tuple(mark.position_m.tolist()) for mark in marks}


def without_repeats(
    times_s: Floats, marks: Sequence[Sequence[MarkRow]]
) -> tuple[tuple[tuple[MarkRow, ...], ...], tuple[SourceEvent, ...]]:
    """The marks of each frame, and the events FROZEN and RESUMED. Frames with repeated values get no marks."""
    watch, used, events = FrozenValues(), [], []
    for time_s, found in zip(times_s.tolist(), marks, strict=True):
        repeats, noticed = watch.saw(time_s, values_of(found))
        used.append(() if repeats else tuple(found))
        events += noticed
    return tuple(used), tuple(events)
