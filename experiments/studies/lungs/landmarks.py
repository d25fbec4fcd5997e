"""Landmarks of breathing lungs, read from a table for each person."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from dynamics.mesh import far_apart
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.tables import Table, read_table

COLUMNS = ("landmark", "phase", "x_mm", "y_mm", "z_mm")
PHASE_S = 0.4
"""Interval between phases [s]: a tenth of a breath."""


@dataclass(frozen=True, slots=True, eq=False)
class Lung:
    """One lung of a person.

    name: name of the file and the side; positions: positions of its landmarks [m], (n_phases, n, 3)
    hull, inner: indices of landmarks on the convex hull in the first phase, and of landmarks inside it
    """

    name: str
    positions: Floats
    hull: NDArray[np.int64]
    inner: NDArray[np.int64]

    @property
    def times_s(self) -> Floats:
        """Times of the phases [s], (n_phases,)."""
        return np.arange(len(self.positions)) * np.float64(PHASE_S)

    def seen(self, n: int | None) -> NDArray[np.int64]:
        """Indices of n landmarks on the hull that are far from each other. If n is None, all landmarks on the hull."""
        if n is None or n >= len(self.hull):
            return self.hull
        places = self.positions[0][self.hull]
        return self.hull[far_apart(places, n)]


def read_lungs(folder: Path) -> list[Lung]:
    """Both lungs of each table `case*.csv` in a folder, in the order of file names. Raises InputError."""
    paths = sorted(folder.glob("case*.csv"))
    if not paths:
        raise InputError.at(folder, "case1.csv and others", "none" if folder.is_dir() else "no folder")
    return [lung for path in paths for lung in read_person(path)]


def read_person(path: Path) -> list[Lung]:
    """The two lungs of a table; the widest gap along x separates them. Raises InputError."""
    positions = _by_phase(read_table(path, COLUMNS))
    return [_lung(path, side, positions[:, own]) for side, own in sides(positions[0]).items()]


def sides(places: Floats) -> dict[str, NDArray[np.bool_]]:
    """Whether each landmark belongs to the right and to the left lung, (n,) each; places: positions, (n, 3)."""
    x = np.sort(places[:, 0])
    gap = int(np.diff(x).argmax())
    right = places[:, 0] <= 0.5 * (x[gap] + x[gap + 1])
    return {"right": right, "left": ~right}


def hull_of(path: Path, side: str, places: Floats) -> ConvexHull:
    """The convex hull of the landmarks of a lung, (n, 3); raises InputError."""
    try:
        return ConvexHull(places)
    except (QhullError, ValueError):
        found = f"{len(places)} that do not"
        raise InputError.at(f"{path}: {side} lung", "landmarks that span a volume", found) from None


def _by_phase(table: Table) -> Floats:
    """Positions from a table with one row for each phase and landmark [m], (n_phases, n_landmarks, 3)."""
    numbers = table.numbers
    if table.n_rows == 0:
        raise InputError.at(table.path, "a row for each landmark in each phase", "none")
    for column in ("landmark", "phase"):
        values = numbers[column]
        table.check(column, (values >= 0) & (values == np.round(values)), "a whole number, 0 or more")
    landmark, phase = numbers["landmark"].astype(int), numbers["phase"].astype(int)
    counts = np.zeros((phase.max() + 1, landmark.max() + 1), dtype=int)
    np.add.at(counts, (phase, landmark), 1)
    if len(counts) < 2:
        raise InputError.at(f"{table.path}: phase", "two phases or more", "one")
    for p, k in np.argwhere(counts != 1):
        found = "none" if counts[p, k] == 0 else f"{counts[p, k]}"
        raise InputError.at(f"{table.path}: landmark {k}, phase {p}", "one row", found)
    positions = np.empty((*counts.shape, 3))
    for axis, column in enumerate(COLUMNS[2:]):
        positions[phase, landmark, axis] = 1e-3 * numbers[column]
    return positions


def _lung(path: Path, side: str, positions: Floats) -> Lung:
    hull = np.unique(hull_of(path, side, positions[0]).simplices).astype(np.int64)
    inner = np.setdiff1d(np.arange(positions.shape[1]), hull)
    if not len(inner):
        raise InputError.at(f"{path}: {side} lung", "landmarks inside its hull", "none")
    return Lung(f"{path.stem} {side}", positions, hull, inner)
