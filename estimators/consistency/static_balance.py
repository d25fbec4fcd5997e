"""Test whether short forces, breathing and the stated errors explain the mean external force over a second.

If a spring is cut or a mark is moved, a filter explains the marks by a persistent force. Its innovations then become
small, although its estimate of the hidden target is wrong. The mean external force shows such a fault. Over a second,
the mean acceleration of a body is almost zero. The mean external force on the marked nodes therefore balances springs
and weight. To compute this force, the force f is averaged over the frames:

    f = -(Fm - Kmh Khh^-1 Fh),   Kc = Kmm - Kmh Khh^-1 Khm

Here K is the stiffness at rest, and F is the force of springs and weight. The indices m and h stand for marked and
hidden nodes (static condensation). F is computed with the marked nodes at their measured positions z, and with the
hidden nodes at rest_h - Khh^-1 Khm (z - rest_m). Near rest, f equals Kc (z - rest). A chi-square test compares the mean
of f with the covariance that a right model predicts. It is due to short forces, whose mean is not exactly zero; to
forces on all nodes in proportion to their masses, as in breathing; to errors of marks, calibration and constants.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from dynamics import (
    MassSpringNetwork,
    ParameterUncertainty,
    node_forces,
    parameter_forces,
    rest_shape,
    stiffness_matrix,
    supported,
)
from estimators.arrays import Floats
from estimators.core.track import TissueFilter
from estimators.process.process_model import LOOSE, ForceMode
from estimators.tissue.estimate import MarkMeasurement


@dataclass(frozen=True, slots=True)
class BalanceSettings:
    """Settings of the static balance.

    mean_s: time over which the force is averaged [s]; choice: over half this time short forces have a large mean; twice
        this time delays the report of a fault that single frames do not show
    least_share: least share of mean_s that the frames cover, and least share of frames that show a node [1]; choice
    often: expected share of the time in which a short force acts on a node [1]; choice: 0.3 s of every 1.8 s
    """

    mean_s: float = 1.0
    least_share: float = 0.5
    often: float = 1.0 / 6.0


BALANCE = BalanceSettings()


@dataclass(frozen=True, slots=True, eq=False)
class Balance:
    """Mean external force on the marked nodes, computed from the measured positions.

    nodes: the k marked nodes that were visible; force: mean external force on each of these nodes [N], (k, dim)
    cov: covariance that a right model predicts for this force [N²], (k dim, k dim)
    """

    nodes: tuple[str, ...]
    force: Floats
    cov: Floats

    @property
    def probability(self) -> float:
        """P-value of the force: if the model is right, the probability of the same or a larger chi-square value."""
        f = self.force.ravel()
        return float(chi2.sf(f @ np.linalg.solve(self.cov, f), len(f)))


Calibration = Callable[[Floats], Floats]
"""Function from points [m], (n, dim), to shifts [m], (n, dim, n_errors): the shift of each point if one of the
independent calibration errors is one standard deviation."""


class StaticBalance:
    """Test of a body's static balance from its marks, frame by frame.

    The test gives no result if a force may drag a node for a long time, see `TissueFilter.may_be_led`.

    uncertainty, calibration: errors of the constants and errors of the camera's calibration; None stands for no errors
    State: the marks of the last frames; cached matrices for each set of visible nodes.
    """

    def __init__(
        self,
        tissue: TissueFilter,
        uncertainty: ParameterUncertainty | None = None,
        calibration: Calibration | None = None,
        settings: BalanceSettings = BALANCE,
    ) -> None:
        self._network: MassSpringNetwork = tissue.network
        # a force that drags a node may last for any time, and the springs then rotate
        self._of = None if tissue.may_be_led else tissue.settings.poked
        self._uncertainty, self._calibration, self._settings = uncertainty, calibration, settings
        self._frames: deque[_Frame] = deque()
        self._seen: dict[tuple[str, ...], _Condensed] = {}
        self._supported, self._rest = supported(self._network), rest_shape(self._network)
        self._stiffness = stiffness_matrix(self._network, self._rest)

    @property
    def mean_s(self) -> float:
        """Time over which forces are averaged [s]; 0 if the body is not tested."""
        return 0.0 if self._of is None else self._settings.mean_s

    def forget(self) -> None:
        """Discard the marks of all frames."""
        self._frames.clear()

    def update(self, time_s: float, marks: Sequence[MarkMeasurement]) -> Balance | None:
        """Balance after a frame at time_s [s]; None if the last frames show too few marks or the body is not tested."""
        if self._of is None:
            return None
        s = self._settings
        self._frames.append(_Frame(time_s, {mark.node: mark for mark in marks}))
        while self._frames[0].time_s <= time_s - s.mean_s:
            self._frames.popleft()
        if time_s - self._frames[0].time_s < s.least_share * s.mean_s:
            return None
        counts = Counter(node for frame in self._frames for node in frame.marks)
        enough = s.least_share * len(self._frames)
        nodes = tuple(sorted(node for node, n in counts.items() if n >= enough))
        together = [frame for frame in self._frames if frame.marks.keys() >= set(nodes)]
        return self._balance(self._of, nodes, together) if nodes and len(together) >= enough else None

    def _balance(self, of: ForceMode, nodes: tuple[str, ...], frames: list[_Frame]) -> Balance:
        """Balance of the given nodes; of: model of the short forces; frames: frames in which all nodes were visible."""
        network, dim, seen = self._network, self._network.dim, self._condensed(nodes)
        at = [network.index(node) for node in nodes]
        poke = np.repeat(of.poke * network.masses[at], dim)
        alike = np.zeros((len(poke), dim))
        alike[np.arange(len(poke)), np.arange(len(poke)) % dim] = poke
        span_s = max(frames[-1].time_s - frames[0].time_s, of.lasting_s)
        averaged = self._settings.often * max(min(2.0 * of.lasting_s / span_s, 1.0), 1.0 / len(frames))
        cov = np.diag(averaged * poke**2 + np.repeat(network.friction[at], dim) ** 2)
        for k, node in enumerate(nodes):  # errors of a mark may be equal in all frames, and then do not average out
            own = seen.stiffness[:, k * dim : (k + 1) * dim]
            cov += own @ frames[-1].marks[node].cov @ own.T
        directions = np.concatenate([alike, seen.forces, seen.stiffness @ seen.marks], axis=1)
        force = np.mean([self._force(nodes, frame) for frame in frames], axis=0).reshape(len(nodes), dim)
        return Balance(nodes, force, cov + directions @ directions.T)

    def _force(self, nodes: tuple[str, ...], frame: _Frame) -> Floats:
        """External force f from the marks of one frame [N], (m,). The module defines f."""
        if nodes not in frame.forces:
            network, seen = self._network, self._condensed(nodes)
            x = self._rest[network.free].ravel()
            away = np.concatenate([frame.marks[node].position for node in nodes]) - x[seen.m]
            x[seen.m] += away
            x[seen.h] -= seen.to_hidden.T @ away
            places = self._rest.copy()
            places[network.free] = x.reshape(-1, network.dim)
            F = node_forces(self._supported, places, np.zeros_like(places))[network.free].ravel()
            frame.forces[nodes] = seen.to_hidden @ F[seen.h] - F[seen.m]
        return frame.forces[nodes]

    def _condensed(self, nodes: tuple[str, ...]) -> _Condensed:
        if nodes not in self._seen:
            network, K, rest = self._network, self._stiffness, self._rest
            places = [network.coordinates(node) for node in nodes]
            m = np.array([i for place in places for i in range(place.start, place.stop)])
            h = np.setdiff1d(np.arange(len(K)), m)
            forces = np.zeros((len(K), 0))
            if self._uncertainty is not None:
                each = parameter_forces(network, self._uncertainty.parameters, rest, np.zeros_like(rest))
                forces = each.T @ self._uncertainty.directions.T
            marks = np.zeros((len(m), 0))
            if self._calibration is not None:
                marks = self._calibration(rest[[network.index(node) for node in nodes]]).reshape(len(m), -1)
            # least squares: if no spring resists a rotation of hidden nodes, they do not rotate
            to_hidden = np.linalg.lstsq(K[np.ix_(h, h)], K[np.ix_(h, m)], rcond=LOOSE)[0].T
            stiffness = K[np.ix_(m, m)] - to_hidden @ K[np.ix_(h, m)]
            self._seen[nodes] = _Condensed(m, h, to_hidden, stiffness, forces[m] - to_hidden @ forces[h], marks)
        return self._seen[nodes]


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """A frame: its time [s], its marks by node, and cached external forces for each set of nodes."""

    time_s: float
    marks: dict[str, MarkMeasurement]
    forces: dict[tuple[str, ...], Floats] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class _Condensed:
    """A body, condensed to the coordinates m of visible nodes, (n_m,); h: coordinates of hidden nodes, (n_h,).

    to_hidden: Kmh Khh^-1 [1], (n_m, n_h); stiffness: Kc [N/m], (n_m, n_m)
    forces: change of the condensed forces if each error of the constants is one standard deviation [N], (n_m, any)
    marks: shift of the coordinates m if each calibration error is one standard deviation [m], (n_m, any)
    """

    m: NDArray[np.int64]
    h: NDArray[np.int64]
    to_hidden: Floats
    stiffness: Floats
    forces: Floats
    marks: Floats
