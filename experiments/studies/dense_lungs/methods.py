"""Dense landmarks of lungs at two times, and methods that estimate hidden landmarks from marks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.spatial import Delaunay

from dynamics import MassSpringNetwork
from dynamics.elements import matern
from dynamics.mesh import far_apart
from estimators import OpenLoop, TargetPoint, TissueFilter
from estimators.core.discrepancy import Discrepancy
from estimators.core.disturbances import Disturbances
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.tables import read_table
from experiments.studies.estimation.trials import Frames, frames_of
from experiments.studies.lungs import STRAND_N, hull_of, lung_network, node_name, sides
from experiments.studies.zoo.run import thin_plate_weights

AXES = ("x", "y", "z")
COLUMNS = ("landmark", *(f"{axis}{time}_mm" for time in (0, 1) for axis in AXES))

WHERE = ("all", "front")
"""Places of marks: all around the lung, or only where y exceeds the median of all landmarks."""

NEAR, DEEP = 0.03, 0.075
"""Largest depth of a mark, and least depth of a hidden landmark [1]; choice. A depth is the distance below the convex
hull divided by the longest extent of the lung."""


@dataclass(frozen=True, slots=True, eq=False)
class Lung:
    """The landmarks of one lung.

    inhaled, exhaled: positions at the end of inhaling and at the end of exhaling [m], (n_landmarks, 3)
    depth: depth below the convex hull divided by the longest extent of the lung [1], (n_landmarks,)
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
        """Indices of at most n landmarks near the hull, chosen far from each other; where: one of `WHERE`."""
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
    """The two lungs of a table. The widest gap along x separates the lungs. Raises InputError for a wrong table."""
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


OTHERS = 60
"""Number of landmarks without a mark that become nodes of a network; numerical."""

BREATH = Disturbances(poke_m_s2=0.01, led_m_s2=0.01, slow_m_s2=(0.0, 0.1), bent=0.0)
"""Prior of a breath's forces: smooth over the lung, without pokes of single marks, 1 % of gravity; choice."""

SMOOTH = Discrepancy(levels=(0.01,), short=0.4, rank=80, least=1e-4)
"""Prior of the displacements that the network does not model; choice, as two frames do not determine their size."""

FRAMES_S = (0.0, 2.0)
"""Times of the end of inhaling and of exhaling [s], half a breath apart."""

FIELD_M = 0.06
"""Correlation length of the Matern field [m]; choice."""

LEVELS_M = np.geomspace(0.2e-3, 50e-3, 25)
"""Candidates for the standard deviation of the Matern field [m]. The marginal likelihood selects one; numerical."""

LARGE_M = 1.0
"""Prior standard deviations [m] of the affine displacement in `by_field`: constant part, and linear part at 0.1 m
from the marks' centre; numerical."""

SCATTER_M = 0.63e-3
"""Sd of a measured position on each axis [m]; source: positions by two persons differ by 1 mm on average: 1.6 sd."""


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Input of all methods: a lung, the indices of its marks, (n_marks,), and strand_n, see `STRAND_N` [N]."""

    lung: Lung
    marks: NDArray[np.int64]
    strand_n: float = STRAND_N

    @property
    def before(self) -> Floats:
        """Positions of the marks at the end of inhaling [m], (n_marks, 3)."""
        return self.lung.inhaled[self.marks]

    @property
    def after(self) -> Floats:
        """Positions of the marks at the end of exhaling [m], (n_marks, 3)."""
        return self.lung.exhaled[self.marks]

    @property
    def wanted(self) -> Floats:
        """Positions of the hidden landmarks at the end of inhaling [m], (n_hidden, 3)."""
        return self.lung.inhaled[self.lung.hidden]

    def frames(self) -> Frames:
        """The frames at the end of inhaling and of exhaling; node k of the network has mark k."""
        names = [node_name(k) for k in range(len(self.marks))]
        return frames_of(FRAMES_S, [self.before, self.after], names, SCATTER_M)


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Estimates of hidden landmarks after exhaling; means [m], (n_hidden, 3); covs [m²], (n_hidden, 3, 3), or None."""

    means: Floats
    covs: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A coarse network of a lung. Its first nodes are the marks; four nodes interpolate each hidden landmark.

    corners: indices of the four nodes, (n_hidden, 4); weights: weights of these nodes, (n_hidden, 4)
    """

    network: MassSpringNetwork
    corners: NDArray[np.int64]
    weights: Floats

    @classmethod
    def of(cls, task: Task) -> Body:
        """Network with the marks and `OTHERS` further landmarks as nodes."""
        points = task.lung.inhaled
        nodes = points[far_apart(points, len(task.marks) + OTHERS, task.marks)]
        mesh = Delaunay(nodes)
        cells = mesh.find_simplex(task.wanted)
        if (cells < 0).any():
            raise ValueError(
                f"{task.lung.name}: expected hidden landmarks among the nodes, found {(cells < 0).sum()} not"
            )
        affine = mesh.transform[cells]
        first = np.einsum("ijk,ik->ij", affine[:, :3], task.wanted - affine[:, 3])
        weights = np.column_stack([first, 1.0 - first.sum(axis=1)])
        return cls(lung_network(nodes, task.strand_n), mesh.simplices[cells], weights)

    def point(self, k: int) -> TargetPoint:
        """Hidden landmark k as a point between four nodes."""
        return TargetPoint(tuple(node_name(int(i)) for i in self.corners[k]), tuple(self.weights[k]))

    def rows(self) -> Floats:
        """Matrix that maps positions of nodes to positions of hidden landmarks, (n_hidden, n_nodes)."""
        found = np.zeros((len(self.corners), self.network.n_nodes))
        np.put_along_axis(found, self.corners, self.weights, axis=1)
        return found


def by_filter(task: Task) -> Found:
    """Estimate by `TissueFilter`. The filter's target is the hidden landmark that is farthest from all marks."""
    body = Body.of(task)
    away = np.linalg.norm(task.wanted[:, None] - task.before, axis=2).min(axis=1)
    frames = task.frames()
    tissue = TissueFilter(
        body.network,
        body.point(int(away.argmax())),
        [mark.node for mark in frames[0][1]],
        disturbances=BREATH,
        discrepancy=SMOOTH,
    )
    for time_s, marks in frames:
        tissue.predict(time_s)
        tissue.update(marks)
    maps = [tissue.process.places(np.kron(row, np.eye(3))) for row in body.rows()]
    found = [tissue.filter.moments(one) for one in maps]
    return Found(np.array([mean for mean, _ in found]), np.array([cov for _, cov in found]))


def by_open_loop(task: Task) -> Found:
    """Estimate by the paper's method with the filter's network. Marks move in straight lines between the frames."""
    body = Body.of(task)
    method = OpenLoop(body.network, body.point(0))
    for time_s, marks in task.frames():
        method.update(time_s, marks)
    return Found(body.rows() @ method.positions)


def by_thin_plate(task: Task) -> Found:
    """Estimate by a thin-plate spline through the displacements of the marks."""
    return Found(task.wanted + thin_plate_weights(task.before, task.wanted) @ (task.after - task.before))


def by_linear(task: Task) -> Found:
    """Estimate by linear radial basis functions with an affine trend."""
    spline = RBFInterpolator(task.before, task.after - task.before, kernel="linear", degree=1)
    return Found(task.wanted + spline(task.wanted))


def by_field(task: Task) -> Found:
    """Estimate by a Gaussian process with affine trend and Matern covariance. The likeliest of `LEVELS_M` is used."""
    center = task.before.mean(axis=0)
    known, wanted = ((places - center) / 0.1 for places in (task.before, task.wanted))
    moved = task.after - task.before

    def trend(one: Floats, other: Floats) -> Floats:
        return np.asarray(LARGE_M**2 * (1.0 + one @ other.T))

    def smooth(one: Floats, other: Floats) -> Floats:
        return matern(0.1 * np.linalg.norm(one[:, None] - other, axis=2), FIELD_M)

    trends, fields, noise = trend(known, known), smooth(known, known), SCATTER_M**2
    likely: list[float] = []
    for level in LEVELS_M:
        S = trends + level**2 * fields + noise * np.eye(len(known))
        likely.append(-3.0 * np.linalg.slogdet(S)[1] - float((moved * np.linalg.solve(S, moved)).sum()))
    level = LEVELS_M[int(np.argmax(likely))]
    S = trends + level**2 * fields + noise * np.eye(len(known))
    cross = trend(wanted, known) + level**2 * smooth(wanted, known)
    own = LARGE_M**2 * (1.0 + (wanted**2).sum(axis=1)) + level**2
    variances = own - np.einsum("ij,ij->i", cross, np.linalg.solve(S, cross.T).T)
    return Found(task.wanted + cross @ np.linalg.solve(S, moved), variances[:, None, None] * np.eye(3))


METHODS: Mapping[str, Callable[[Task], Found]] = {
    "filter": by_filter,
    "thin_plate": by_thin_plate,
    "linear": by_linear,
    "field": by_field,
    "open_loop": by_open_loop,
    "none": lambda task: Found(task.wanted),
}
"""Methods by their names in the outputs."""
