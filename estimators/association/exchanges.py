"""Names of interchangeable marks: cost of each assignment in a frame, and plausible exchanges of names.

A mark has the name of a node, but may be on another node. `Names` state where the marks are: the mark with the name of
node j is on node `names[j]`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats
from estimators.core.track import TissueFilter
from estimators.filters.kernels import ambiguous_exchanges, association_costs
from estimators.tissue.estimate import MarkMeasurement

Names = tuple[int, ...]


class InterchangeableMarks:
    """Groups of nodes whose marks are interchangeable. Names are never exchanged between groups.

    nodes: names of the nodes in all groups, without groups of one node
    own: the `Names` without any exchange, with each mark on the node of its name
    """

    def __init__(self, tissue: TissueFilter, groups: Iterable[Collection[str]]) -> None:
        kinds = [tuple(group) for group in groups if len(group) > 1]
        self.nodes = tuple(node for group in kinds for node in group)
        self.own: Names = tuple(range(len(self.nodes)))
        kind = np.array([k for k, group in enumerate(kinds) for _ in group])
        self._pairs = np.triu(kind[:, None] == kind[None, :], 1)
        self._place = {node: i for i, node in enumerate(self.nodes)}

    def by_node(self, names: Names) -> dict[str, str]:
        """Map from the name of each mark to the name of the node that the mark is on."""
        return {self.nodes[i]: self.nodes[new] for i, new in enumerate(names)}

    def costs(self, tissue: TissueFilter, marks: Sequence[MarkMeasurement], *, starting: bool = False) -> Floats:
        """Cost (n, n) of the assumption that mark j is on node i: -log of the predicted density of the mark's position.

        If a mark is absent, its column is 0. If `starting`, the prior gives the density.
        """
        costs = np.zeros((len(self.nodes), len(self.nodes)))
        seen = [mark for mark in marks if mark.node in self._place]
        if not seen:
            return costs
        means, covs = (tissue.expected_at_rest if starting else tissue.expected_of)(self.nodes)
        z, R = np.array([mark.position for mark in seen]), np.array([mark.total_cov for mark in seen])
        costs[:, [self._place[mark.node] for mark in seen]] = association_costs(means, covs, z, R)
        return costs

    def others(self, names: Names, costs: Floats, worst: float, most: int) -> Mapping[Names, int]:
        """Plausible alternatives to `names`, the most probable first, each with the number of exchanges leading to it.

        worst: largest additional cost of an alternative in this frame; most: largest number of alternatives
        """
        if names == self.own and not ambiguous_exchanges(costs, self._pairs, worst):
            return {}
        seen = costs.any(axis=0)
        pairs: NDArray[np.bool_] = self._pairs & np.logical_or.outer(seen, seen)
        found: dict[Names, tuple[float, int]] = {names: (0.0, 0)}
        ahead = [names]
        while ahead and len(found) <= most:
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
        best = sorted(found, key=lambda one: -found[one][0])[:most]
        return {one: found[one][1] for one in best}


def seen_from(names: Names, new: Names) -> Names:
    """`names` after the marks are renamed: the mark with name i gets name `new[i]`, but stays on node `names[i]`."""
    seen = [0] * len(names)
    for i, node in enumerate(new):
        seen[node] = names[i]
    return tuple(seen)


def renamed(marks: Iterable[MarkMeasurement], names: Mapping[str, str]) -> tuple[MarkMeasurement, ...]:
    """The marks after their nodes are renamed: a node that is a key of `names` becomes the value of this key."""
    return tuple(
        mark if (node := names.get(mark.node, mark.node)) == mark.node else replace(mark, node=node) for mark in marks
    )
