"""Which of the marks that look alike is which: names as hypotheses, a filter for each while they are in doubt."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np
from numpy.typing import NDArray

from estimators.estimate import MarkMeasurement, Status, TargetEstimate
from estimators.health import Health, diverged
from estimators.kernels import names_in_doubt, naming_costs
from estimators.tissue import Snapshot, TissueFilter
from estimators.unscented import CovarianceError

Floats = NDArray[np.float64]
Names = tuple[int, ...]

DOUBT = log(1e3)
"""Names are in doubt that are worse than those told by less than this, by one frame; chosen: odds of 1,000 to 1."""
RARE = log(1e2)
"""What an exchange of two names costs before anything was seen of it; chosen: one in a hundred doubts is one."""
SURE = log(1e3)
"""By so much, beyond that, other names must be better before they are believed; chosen."""
UNEASY_SIGMAS = 5.0
"""Innovations as improbable as this may come of wrong names, which are then tried from a start; chosen."""
PAUSE_S, LONGEST_PAUSE_S = 0.5, 60.0
"""Not again within this time after that; each time in vain makes it twice as long, up to the other [s]; chosen."""
MOST = 5
"""Other names at most that are followed at a time, the best: those of three marks alike; chosen."""
LONGEST_S = 5.0
"""Names that were neither believed nor ruled out for so long are no longer followed [s]; chosen."""


@dataclass(frozen=True, slots=True)
class Swap:
    """Marks that had been taken for each other, and are no longer.

    time_s, since_s: when it was undone, and since when it had been so [s]; nodes: whose marks they are
    """

    time_s: float
    since_s: float
    nodes: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """What came of a frame: the estimate, the marks by the names that they bear now, a swap if one was undone."""

    estimate: TargetEstimate
    marks: tuple[MarkMeasurement, ...]
    swap: Swap | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Rival:
    """Other names for the marks, and what the filter would know had it believed them.

    names: by place among the nodes alike, the place of the node that a mark of that name is on
    ahead: log of how much more probable than the names that are believed, negative as long as they are less
    since_s: since when the names differ [s]
    """

    names: Names
    ahead: float
    since_s: float
    knows: Snapshot
    estimate: TargetEstimate


class Identity:
    """Takes marks in, and goes over to other names for those that look alike once they explain clearly more.

    A hidden Markov model of the names. In each frame an exchange of two names that the frame alone does not rule out
    makes a rival: the filter as it was before, given the marks by those names, and followed from then on. Of two ways
    to the same names the more probable is kept (Viterbi's algorithm). The probability of a rival is the product of the
    likelihoods of its marks, frame by frame, with RARE for each exchange. It is dropped when it is clearly the worse;
    when it is clearly the better, and TRACKING, the filter goes on as if it had been believed from the start, and the names with it.

    Where nothing is believed yet, any names may be right: at a start, after a divergence, and when innovations are
    too large for some time. Then those which lie best about the rest shape start the filter anew, each its own; for the
    tissue may be turned or displaced, that counts for no more than DOUBT. One by the names that are believed starts anew
    beside them (the same_names one), which they must beat as well: or else a filter that knows nothing, and is refuted
    by nothing, would win by that and not by its names.

    tissue: the filter; predict it, and then come here with the marks
    alike: groups of nodes whose marks look alike; names are never exchanged between groups
    State: called, the node of each mark that another gave a name to, if it is another one; rivals; swaps undone; when
    the names may next be tried from a start, and how long the pause after that is.
    """

    def __init__(self, tissue: TissueFilter, alike: Iterable[Collection[str]]) -> None:
        self.tissue = tissue
        groups = [tuple(group) for group in alike if len(group) > 1]
        self._nodes = tuple(node for group in groups for node in group)
        kind = np.array([k for k, group in enumerate(groups) for _ in group])
        self._pairs = np.triu(kind[:, None] == kind[None, :], 1)
        self._place = {node: i for i, node in enumerate(self._nodes)}
        network = tissue.model.network
        states = range(network.n_state)
        self._rows = np.array([states[network.coordinates(node)] for node in self._nodes], dtype=np.int64)
        self._own: Names = tuple(range(len(self._nodes)))
        self.called: dict[str, str] = {}
        self.rivals: list[Rival] = []
        self.swaps: list[Swap] = []
        self._same_names: Rival | None = None
        self._next_s, self._pause_s = -np.inf, PAUSE_S

    def named(self, marks: Sequence[MarkMeasurement]) -> tuple[MarkMeasurement, ...]:
        """Marks that another tracker named, by the nodes that they are believed to be on."""
        return tuple(_renamed(mark, self.called) for mark in marks)

    def fix(self, position: Floats, cov: Floats) -> TargetEstimate:
        """Take in a sighting of the target, as `TissueFilter.fix` does, whatever the names."""
        time_s, tissue = self.tissue.time_s, self.tissue
        estimate = tissue.fix(position, cov)
        if self.rivals and time_s is not None:
            now = tissue.snapshot()
            self.rivals = [self._fixed(rival, time_s, position, cov) for rival in self.rivals]
            if self._same_names is not None:
                self._same_names = self._fixed(self._same_names, time_s, position, cov)
            tissue.restore(now)
        return estimate

    def _fixed(self, rival: Rival, time_s: float, position: Floats, cov: Floats) -> Rival:
        self.tissue.restore(rival.knows)
        self.tissue.predict(time_s)
        self.tissue.fix(position, cov)
        return replace(rival, knows=self.tissue.snapshot())

    def update(self, marks: Sequence[MarkMeasurement]) -> Named:
        """Take in marks by the nodes that they are believed to be on, at the filter's time.

        Raises ValueError and CovarianceError as the filter does.
        """
        tissue = self.tissue
        before = tissue.snapshot()
        anew = tissue.health.since_s is None or tissue.health.status is Status.LOST
        others = {} if anew else self._others(self._own, self._costs(marks))
        estimate = tissue.update(marks)
        if anew:
            self.rivals, self._same_names = [], None
        try_all = anew or self._uneasy(estimate)
        if not others and not self.rivals and not try_all:
            return Named(estimate, tuple(marks))
        told = tissue.log_likelihood
        readings = {self._own: Rival(self._own, 0.0, estimate.time_s, tissue.snapshot(), estimate)}
        for names, n_changes in others.items():
            self._follow(readings, before, (names, -told - n_changes * RARE, estimate.time_s), marks)
        for rival in self.rivals:
            predicted = self._predicted(rival, estimate.time_s)
            ways = self._others(rival.names, self._costs(marks))
            self._follow(readings, predicted, (rival.names, rival.ahead - told, rival.since_s), marks)
            for names, n_changes in ways.items():
                if names != self._own:
                    ahead = rival.ahead - told - n_changes * RARE
                    self._follow(readings, predicted, (names, ahead, estimate.time_s), marks)
        same, self._same_names = self._same_names, None
        if same is not None:
            predicted = self._predicted(same, estimate.time_s)
            self._same_names = self._read(predicted, (same.names, same.ahead - told, same.since_s), marks)
        if try_all and max(one.ahead for one in readings.values()) <= SURE:
            self._start_anew(readings, before, marks, beside=not anew)
        return self._decided(readings, marks)

    def _predicted(self, rival: Rival, time_s: float) -> Snapshot:
        self.tissue.restore(rival.knows)
        self.tissue.predict(time_s)
        return self.tissue.snapshot()

    def _uneasy(self, estimate: TargetEstimate) -> bool:
        """Whether the innovations are such that any names may be right, and it is time to try them."""
        tested, now_s = self.tissue.health.innovations, estimate.time_s
        refuted = estimate.status is Status.DIVERGED and not tested
        if refuted:
            return True
        if now_s < self._next_s or not estimate.marks_used or not diverged(tested, UNEASY_SIGMAS):
            return False
        if now_s - self._next_s > self._pause_s:
            self._pause_s = PAUSE_S
        self._next_s = now_s + self._pause_s
        self._pause_s = min(2.0 * self._pause_s, LONGEST_PAUSE_S)
        return True

    def _start_anew(
        self, readings: dict[Names, Rival], before: Snapshot, marks: Sequence[MarkMeasurement], *, beside: bool
    ) -> None:
        """Start the filter anew by other names, and by the same beside them."""
        costs = self._costs(marks, anew=True)
        nothing = replace(before, health=Health())
        if costs is None:
            return
        own = float(costs.trace())
        for names, n_changes in self._others(self._own, costs, np.inf).items():
            self.tissue.restore(nothing)
            estimate = self.tissue.update([_renamed(mark, self._by_node(names)) for mark in marks])
            better = own - float(costs[list(names), range(len(names))].sum())
            ahead = float(np.clip(better, -DOUBT, DOUBT)) - n_changes * RARE
            _keep(readings, Rival(names, ahead, estimate.time_s, self.tissue.snapshot(), estimate))
        if beside:
            self.tissue.restore(nothing)
            estimate = self.tissue.update(marks)
            self._same_names = Rival(self._own, 0.0, estimate.time_s, self.tissue.snapshot(), estimate)

    def _follow(
        self,
        readings: dict[Names, Rival],
        before: Snapshot,
        way: tuple[Names, float, float],
        marks: Sequence[MarkMeasurement],
    ) -> None:
        """Keep what comes of other names, if it is better than what is known of them."""
        rival = self._read(before, way, marks)
        if rival is not None:
            _keep(readings, rival)

    def _read(
        self, before: Snapshot, way: tuple[Names, float, float], marks: Sequence[MarkMeasurement]
    ) -> Rival | None:
        """Take the marks in by these names: way has them, how far ahead without this frame, and since when [s]."""
        names, ahead, since_s = way
        self.tissue.restore(before)
        try:
            estimate = self.tissue.update([_renamed(mark, self._by_node(names)) for mark in marks])
        except CovarianceError:
            return None
        return Rival(names, ahead + self.tissue.log_likelihood, since_s, self.tissue.snapshot(), estimate)

    def _decided(self, readings: dict[Names, Rival], marks: Sequence[MarkMeasurement]) -> Named:
        """Believe the best names if they are clearly so, and keep those that are not clearly worse."""
        best, own = max(readings.values(), key=lambda one: one.ahead), readings[self._own]
        same = 0.0 if self._same_names is None else max(0.0, self._same_names.ahead)
        if best.ahead <= same + SURE or best.estimate.status is not Status.TRACKING:
            best = own
        self.tissue.restore(best.knows)
        now_s, turned = best.estimate.time_s, self._by_node(best.names)
        swap = None
        if best.names != self._own:
            moved = tuple(node for node, other in turned.items() if node != other)
            swap = Swap(now_s, best.since_s, moved)
            self.swaps.append(swap)
            called = {node: turned[self.called.get(node, node)] for node in self._nodes}
            self.called = {node: other for node, other in called.items() if node != other}
        others = []
        for one in readings.values():
            ahead = one.ahead - best.ahead
            worst = max(best.ahead, same) - DOUBT - RARE - SURE
            if one is best or one.ahead < worst or now_s - one.since_s > LONGEST_S:
                continue
            names = [0] * len(self._own)
            for i, new in enumerate(best.names):
                names[new] = one.names[i]
            others.append(replace(one, names=tuple(names), ahead=ahead))
        self.rivals = sorted(others, key=lambda one: -one.ahead)[:MOST]
        if swap is not None or not self.rivals:
            self._same_names = None
        return Named(best.estimate, tuple(_renamed(mark, turned) for mark in marks), swap)

    def _by_node(self, names: Names) -> dict[str, str]:
        return {self._nodes[i]: self._nodes[new] for i, new in enumerate(names)}

    def _costs(self, marks: Sequence[MarkMeasurement], *, anew: bool = False) -> Floats | None:
        """By what the filter expects now, what it costs that the mark named after node j is on node i: (n, n).

        anew: by where nodes may be at a start
        Nothing for a mark that is not seen; None where there are no names to be exchanged.
        """
        places = [self._place[mark.node] for mark in marks if mark.node in self._place]
        if not places:
            return None
        seen = [mark for mark in marks if mark.node in self._place]
        if anew:
            beliefs = [self.tissue.at_start(node) for node in self._nodes]
            means, covs = np.array([mean for mean, _ in beliefs]), np.array([cov for _, cov in beliefs])
        else:
            poked, rows = self.tissue.mixture.filters[-1], self._rows
            columns = self.tissue.mixture.columns[-1][rows]
            means, covs = poked.x[rows], poked.P[rows[:, :, None], rows[:, None, :]] + columns @ columns.swapaxes(1, 2)
        costs = np.zeros((len(self._nodes), len(self._nodes)))
        z, R = np.array([mark.position for mark in seen]), np.array([mark.total_cov for mark in seen])
        costs[:, places] = naming_costs(means, covs, z, R)
        return costs

    def _others(self, names: Names, costs: Floats | None, worst: float = DOUBT) -> Mapping[Names, int]:
        """Names that exchanges of two lead to from these, none worse by more than `worst` in this frame: how many.

        The best first, as many as are followed at most.
        """
        if costs is None or (names == self._own and not names_in_doubt(costs, self._pairs, worst)):
            return {}
        seen = costs.any(axis=0)
        pairs = self._pairs & (seen[:, None] | seen[None, :])
        found: dict[Names, tuple[float, int]] = {names: (0.0, 0)}
        ahead = [names]
        while ahead and len(found) <= MOST:
            now = ahead.pop(0)
            gain, n_changes = found[now]
            taken = costs[list(now)]
            fits = taken.diagonal()
            gains = fits[:, None] + fits[None, :] - taken - taken.T
            for i, j in zip(*np.nonzero(pairs & (gains > -worst - gain)), strict=True):
                other = list(now)
                other[i], other[j] = now[j], now[i]
                if tuple(other) not in found:
                    found[tuple(other)] = gain + float(gains[i, j]), n_changes + 1
                    ahead.append(tuple(other))
        del found[names]
        best = sorted(found, key=lambda one: -found[one][0])[:MOST]
        return {one: found[one][1] for one in best}


def _keep(readings: dict[Names, Rival], one: Rival) -> None:
    known = readings.get(one.names)
    if known is None or one.ahead > known.ahead:
        readings[one.names] = one


def _renamed(mark: MarkMeasurement, names: Mapping[str, str]) -> MarkMeasurement:
    node = names.get(mark.node, mark.node)
    return mark if node == mark.node else replace(mark, node=node)
