"""Real breathing lungs: the filter and a spline estimate inner landmarks from landmarks on the convex hull.

    python -m experiments.studies.lungs FOLDER              # prints the table; --page writes it to docs/zoo.md

FOLDER has tables `case1.csv`, `case2.csv` etc. with columns `landmark,phase,x_mm,y_mm,z_mm`. Phase 0 is at the end of
inhaling, the last phase at the end of exhaling. The page uses the landmarks of DIR-Lab [castillo2009], which are not
part of the repository. The model of a lung has no fixed nodes. Latest figures: docs/zoo.md.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, Delaunay, QhullError

from dynamics import MassSpringNetwork, build_network
from dynamics.mesh import far_apart
from estimators import TissueFilter, coverage, normalised_error_squared
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.page import markdown_table
from experiments.formats.tables import Table, read_table
from experiments.studies.estimation.trials import Frames, frames_of
from experiments.studies.grid import command, publish, runs_of, study_options
from experiments.studies.zoo.run import thin_plate_weights
from experiments.studies.zoo.scores import Followed, followed

COLUMNS = ("landmark", "phase", "x_mm", "y_mm", "z_mm")
PHASE_S = 0.4
"""Interval between phases [s]: a tenth of a breath."""


@dataclass(frozen=True, slots=True, eq=False)
class Lung:
    """One lung of a person.

    name: name of the file, then the side; positions: positions of the landmarks [m], (n_phases, n_landmarks, 3)
    hull: indices of the landmarks on the convex hull of the first phase; inner: indices of the landmarks inside it
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
        """Indices of landmarks on the hull: n landmarks that are far from each other, or all landmarks if n is None."""
        if n is None or n >= len(self.hull):
            return self.hull
        return self.hull[far_apart(self.positions[0][self.hull], n)]


def read_lungs(folder: Path) -> list[Lung]:
    """Both lungs of each table `case*.csv` in a folder, ordered by name. Raises InputError if there is no table."""
    paths = sorted(folder.glob("case*.csv"))
    if not paths:
        raise InputError.at(folder, "case1.csv and others", "none" if folder.is_dir() else "no folder")
    return [lung for path in paths for lung in read_person(path)]


def read_person(path: Path) -> list[Lung]:
    """The two lungs of a table. The widest gap along x separates the lungs. Raises InputError for a wrong table."""
    positions = _by_phase(read_table(path, COLUMNS))
    return [_lung(path, side, positions[:, own]) for side, own in sides(positions[0]).items()]


def sides(places: Floats) -> dict[str, NDArray[np.bool_]]:
    """Masks of the landmarks in the right and in the left lung, (n_landmarks,); places: positions, (n_landmarks, 3)."""
    x = np.sort(places[:, 0])
    gap = int(np.diff(x).argmax())
    right = places[:, 0] <= 0.5 * (x[gap] + x[gap + 1])
    return {"right": right, "left": ~right}


def hull_of(path: Path, side: str, places: Floats) -> ConvexHull:
    """The convex hull of `places`, (n, 3). If it has no volume, raises InputError with the names of file and side."""
    try:
        return ConvexHull(places)
    except (QhullError, ValueError):
        found = f"{len(places)} that do not"
        raise InputError.at(f"{path}: {side} lung", "landmarks that span a volume", found) from None


def _by_phase(table: Table) -> Floats:
    """Positions [m], (n_phases, n_landmarks, 3), from a table with one row for each phase and landmark."""
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


STRAND_N = 0.8
"""Stiffness of a spring times its length [N]; choice: 2 kPa times 20 mm x 20 mm, as for a strand of tissue."""
DAMPING_S, MASS_KG = 0.1, 0.5
"""Ratio of a spring's damping to its stiffness [s]; mass of a lung, spread evenly over its landmarks [kg]; choice."""
READING_SD_M = 1e-3
"""Sd of a landmark's measured position on each axis [m]; source: two persons differ by about 1 mm."""


def node_name(landmark: int) -> str:
    """Name of a landmark's node."""
    return f"L{landmark}"


def edges_of(points: Floats) -> NDArray[np.int64]:
    """Edges of the Delaunay tetrahedra of the points, without repetitions, (n_edges, 2); points: (n, 3)."""
    tetrahedra = Delaunay(points).simplices
    pairs = np.concatenate([tetrahedra[:, pair] for pair in combinations(range(4), 2)])
    return np.unique(np.sort(pairs, axis=1), axis=0).astype(np.int64)


def lung_network(points: Floats, strand_n: float = STRAND_N) -> MassSpringNetwork:
    """A network without gravity, at rest in these points [m], (n, 3); strand_n: see `STRAND_N` [N]."""
    n = len(points)
    springs = edges_of(points)
    lengths = np.linalg.norm(points[springs[:, 1]] - points[springs[:, 0]], axis=1)
    stiffness = strand_n / lengths
    return build_network(
        list(map(node_name, range(n))),
        points,
        springs.tolist(),
        stiffness=stiffness,
        damping=DAMPING_S * stiffness,
        masses=MASS_KG / n,
        rest_lengths=lengths,
        gravity=np.zeros(3),
    )


SEEN: Mapping[str, int | None] = {"all of the hull": None, "ten": 10, "six": 6}
"""Number of landmarks on the hull that serve as marks, by name of the row; None: all landmarks on the hull."""


def by_spline(lung: Lung, seen: str) -> pd.DataFrame:
    """Errors of a thin-plate spline, and errors if all landmarks are assumed to be at rest; seen: one of `SEEN`.

    Each inner landmark has a row for each phase after the first.
    """
    marked = lung.seen(SEEN[seen])
    start, truth = lung.positions[0], lung.positions[1:, lung.inner]
    moved = lung.positions[1:, marked] - start[marked]
    spline = start[lung.inner] + thin_plate_weights(start[marked], start[lung.inner]) @ moved
    return pd.DataFrame(
        {
            "lung": lung.name,
            "seen": seen,
            "phase": np.repeat(np.arange(1, len(lung.positions)), len(lung.inner)),
            "nothing_mm": 1e3 * np.linalg.norm(start[lung.inner] - truth, axis=2).ravel(),
            "spline_mm": 1e3 * np.linalg.norm(spline - truth, axis=2).ravel(),
        }
    )


def inner_landmarks(job: tuple[Lung, str]) -> pd.DataFrame:
    """Errors of all methods on one lung; job: the lung, and one of `SEEN`.

    filter_mm, nees: error and NEES of the filter; if the filter failed, they are NaN, and `failure` has the reason
    """
    lung, seen = job
    filtered = followed_lung(lung, lung.seen(SEEN[seen]))
    found = by_spline(lung, seen).assign(filter_mm=np.nan, nees=np.nan, failure="")
    if filtered.failure:
        return found.assign(failure=f"not possible yet: {filtered.failure}")
    errors = (filtered.means[1:] - lung.positions[1:, lung.inner]).reshape(-1, 3)
    # a person has measured the true position, so that it has an error, too
    read = filtered.covs[1:].reshape(-1, 3, 3) + READING_SD_M**2 * np.eye(3)
    return found.assign(filter_mm=1e3 * np.linalg.norm(errors, axis=1), nees=normalised_error_squared(errors, read))


def lung_frames(lung: Lung, marked: NDArray[np.int64]) -> Frames:
    """Frames of a lung, one for each phase; marked: indices of the landmarks that are marks."""
    return frames_of(lung.times_s, lung.positions[:, marked], [node_name(i) for i in marked], READING_SD_M)


def followed_lung(lung: Lung, marked: NDArray[np.int64]) -> Followed:
    """The filter's estimates of a lung's inner landmarks."""
    network = lung_network(lung.positions[0])
    inner = [node_name(i) for i in lung.inner]
    begun = partial(TissueFilter, network, inner[0], [node_name(i) for i in marked])
    return followed(begun, network, inner, lung_frames(lung, marked))


HEAD = (
    "landmarks seen",
    "no motion [mm]",
    "spline [mm]",
    "filter [mm]",
    "coverage",
    "spline, all phases [mm]",
    "filter, all phases [mm]",
    "coverage, all phases",
)


def markdown(errors: pd.DataFrame) -> str:
    """Table in Markdown, and below it the number of failed runs for each reason; errors: rows of `inner_landmarks`."""
    rows = []
    for seen in SEEN:
        own = errors[errors["seen"] == seen]
        last = own[own["phase"] == own["phase"].max()]
        exhaled = [_mean(last, f"{method}_mm") for method in ("nothing", "spline", "filter")]
        all_phases = [_mean(own, f"{method}_mm") for method in ("spline", "filter")]
        rows.append((seen, *exhaled, _covered(last), *all_phases, _covered(own)))
    runs = errors.drop_duplicates(["lung", "seen"])
    reasons = runs[runs["failure"] != ""].groupby("failure", sort=False).size()
    failed = [f"- filter, {n} of {len(runs)} runs: {reason}" for reason, n in reasons.items()]
    return (markdown_table(HEAD, rows) + "\n" + "\n".join(failed)).rstrip() + "\n"


def _mean(table: pd.DataFrame, column: str) -> str:
    """Mean of the column as text; empty if a value is missing."""
    return "" if table[column].isna().any() else f"{table[column].mean():.2f}"


def _covered(table: pd.DataFrame) -> str:
    nees = table["nees"].to_numpy()
    return "" if np.isnan(nees).any() else f"{100 * coverage(nees, 3):.1f}%"


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study on a folder of landmarks, and print the table."""
    parser = study_options(__doc__, out=False, page="zoo.md")
    parser.add_argument("folder", type=Path, help="folder with case1.csv and so on")
    given = parser.parse_args(arguments)
    jobs = [(lung, seen) for seen in SEEN for lung in read_lungs(given.folder)]
    page = markdown(pd.concat(runs_of(inner_landmarks, jobs, given), ignore_index=True))
    publish(given, page, {"lungs table": page})


if __name__ == "__main__":
    sys.exit(main())
