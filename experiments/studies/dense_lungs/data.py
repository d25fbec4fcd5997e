"""Dense landmarks of lungs at two times, read from a table for each person."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynamics.mesh import far_apart
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.tables import read_table
from experiments.studies.lungs.landmarks import hull_of, sides

AXES = ("x", "y", "z")
COLUMNS = ("landmark", *(f"{axis}{time}_mm" for time in (0, 1) for axis in AXES))

WHERE = ("all", "front")
"""Places of marks: all around the lung, or only where y is above the median."""

NEAR, DEEP = 0.03, 0.075
"""Largest depth of marks and least depth of hidden landmarks below the convex hull, relative to the lung's longest
extent [1]; choice."""


@dataclass(frozen=True, slots=True, eq=False)
class Lung:
    """One lung: landmarks at the end of inhaling and of exhaling [m], (n, 3) each.

    depth: depth of each landmark below the convex hull, relative to the lung's longest extent [1], (n,)
    """

    name: str
    inhaled: Floats
    exhaled: Floats
    depth: Floats

    @property
    def hidden(self) -> NDArray[np.int64]:
        """Indices of the landmarks whose positions are estimated."""
        return np.flatnonzero(self.depth > DEEP)

    def marks(self, n: int, where: str) -> NDArray[np.int64]:
        """Indices of at most n landmarks near the hull that are far from each other; where: one of `WHERE`."""
        near = self.depth <= NEAR
        if where == "front":
            near &= self.inhaled[:, 1] > np.median(self.inhaled[:, 1])
        own = np.flatnonzero(near)
        return own[far_apart(self.inhaled[own], n)]


def read_lungs(folder: Path) -> list[Lung]:
    """Both lungs of each table in a folder, in the order of file names. Raises InputError."""
    paths = sorted(folder.glob("*.csv"))
    if not paths:
        found = "none" if folder.is_dir() else "no folder"
        raise InputError.at(folder, "tables of landmarks, case1.csv and others", found)
    return [lung for path in paths for lung in read_person(path)]


def read_person(path: Path) -> list[Lung]:
    """The two lungs of a table; the widest gap along x separates them. Raises InputError."""
    table = read_table(path, COLUMNS)
    if table.n_rows < 2:
        raise InputError.at(path, "rows of two lungs", f"{table.n_rows}")
    landmark = table.numbers["landmark"]
    first = np.zeros(table.n_rows, dtype=bool)
    first[np.unique(landmark, return_index=True)[1]] = True
    table.check("landmark", first, "each landmark once")
    inhaled, exhaled = (1e-3 * np.column_stack([table.numbers[f"{axis}{time}_mm"] for axis in AXES]) for time in (0, 1))
    return [_lung(path, side, inhaled[own], exhaled[own]) for side, own in sides(inhaled).items()]


def _lung(path: Path, side: str, inhaled: Floats, exhaled: Floats) -> Lung:
    planes = hull_of(path, side, inhaled).equations
    depth = -(inhaled @ planes[:, :3].T + planes[:, 3]).max(axis=1) / np.ptp(inhaled, axis=0).max()
    lung = Lung(f"{path.stem} {side}", inhaled, exhaled, depth)
    if not len(lung.hidden):
        raise InputError.at(f"{path}: {side} lung", f"landmarks deeper than {100 * DEEP:g} % of the extent", "none")
    return lung
