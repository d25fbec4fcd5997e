"""Groups of constants, such as the stiffness of all springs of one tissue, that are multiplied by one factor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dynamics import (
    KINDS,
    OF_SPRINGS,
    MassSpringNetwork,
    Parameter,
    parameter_label,
    parameter_value,
    parameters,
    scale_parameters,
)
from estimators.arrays import Floats

MOST_SINGLE = 24
"""Largest number of groups of one kind of constant, unless the springs have group names. Each group adds a state to the
filter, but half a minute of recording determines only about twenty combinations of constants."""

LEAST_REST = 0.1
"""Smallest factor for a rest length [1]. Lower stiffness needs a smaller rest length for the same tension."""

SAME_DIGITS = 9
"""Constants of one kind are equal if they agree to this number of significant digits, as many as in a scene file."""


@dataclass(frozen=True, slots=True)
class ConstantGroup:
    """Constants of one kind that are multiplied by one factor; places: indices of the springs or nodes."""

    kind: str
    places: tuple[int, ...]
    name: str

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The constants of the group."""
        return tuple(Parameter(self.kind, place) for place in self.places)


def constant_groups(
    network: MassSpringNetwork,
    kinds: Sequence[str] = KINDS,
    spring_groups: Sequence[str] = (),
    *,
    rests_as_drawn: bool = False,
) -> tuple[ConstantGroup, ...]:
    """Groups of the positive constants of these kinds. All constants of a group are estimated with one factor.

    spring_groups: name of each spring's group, (n_springs,); a spring with an empty name is a group of its own
    If all names are empty, up to `MOST_SINGLE` springs are groups of their own. More springs form groups of equal
    stiffness, and more than `MOST_SINGLE` such groups become one group. Nodes follow the same rules.
    rests_as_drawn: True if the drawn shape was measured at rest; then groups of several rest lengths are omitted
    """
    if len(spring_groups) not in (0, len(network.springs)):
        raise ValueError(f"spring_groups: expected {len(network.springs)} names, found {len(spring_groups)}")
    groups: list[ConstantGroup] = []
    for kind in KINDS:
        if kind in kinds:
            own = parameters(network, (kind,))
            names = _spring_names(network, spring_groups) if kind in OF_SPRINGS else _node_names(network, own)
            gathered: dict[str | int, list[Parameter]] = {}
            for one in own:
                # a constant without a name is a group of its own; two springs between the same nodes have equal labels
                gathered.setdefault(names.get(one.index, one.index), []).append(one)
            groups += [
                ConstantGroup(
                    kind,
                    tuple(one.index for one in group),
                    f"{kind} {name}" if isinstance(name, str) else parameter_label(network, group[0]),
                )
                for name, group in gathered.items()
            ]
    return tuple(group for group in groups if not (rests_as_drawn and _shares("rest_length", group)))


def members(groups: Sequence[ConstantGroup]) -> tuple[Parameter, ...]:
    """The constants of all groups, group by group."""
    return tuple(one for group in groups for one in group.parameters)


def touched(groups: Sequence[ConstantGroup]) -> tuple[Parameter, ...]:
    """All constants that the groups' factors change, including the rest lengths that `scale_groups` changes."""
    rest = (Parameter("rest_length", s) for group in groups if _shares("stiffness", group) for s in group.places)
    return tuple(dict.fromkeys([*members(groups), *rest]))


def scale_groups(network: MassSpringNetwork, groups: Sequence[ConstantGroup], change: ArrayLike) -> MassSpringNetwork:
    """The network with the constants of each group multiplied by exp(change), (n_groups,).

    If a factor changes the stiffness of several springs, their rest lengths also change. The tensions in the drawn
    shape then stay constant, and a tissue that is at rest in the drawn shape remains at rest.
    """
    logs = np.asarray(change, dtype=float)
    which = members(groups)
    by_member = np.repeat(logs, [len(group.places) for group in groups])
    found = scale_parameters(network, which, by_member)
    rest = found.rest_lengths.copy()
    drawn = _drawn_lengths(network)
    for group, log in zip(groups, logs, strict=True):
        if _shares("stiffness", group):
            own = np.array(group.places)
            strain = drawn[own] / network.rest_lengths[own] - 1.0
            rest[own] *= np.maximum(1.0 - strain * np.expm1(-log), LEAST_REST)
    return scale_parameters(
        found,
        [Parameter("rest_length", s) for s in range(len(rest))],
        np.log(rest / found.rest_lengths),
    )


def group_directions(network: MassSpringNetwork, groups: Sequence[ConstantGroup], which: Sequence[Parameter]) -> Floats:
    """Derivatives of the logs of n constants with respect to the log of each group's factor, (n_groups, n)."""
    column = {one: k for k, one in enumerate(which)}
    drawn = _drawn_lengths(network)
    directions = np.zeros((len(groups), len(which)))
    for row, group in zip(directions, groups, strict=True):
        row[[column[one] for one in group.parameters]] = 1.0
        if _shares("stiffness", group):
            for s in group.places:
                if (one := Parameter("rest_length", s)) in column:
                    row[column[one]] += drawn[s] / network.rest_lengths[s] - 1.0
    return directions


def group_label(group: ConstantGroup) -> str:
    """Name of a group: `stiffness M1-M2` for one constant, `stiffness skin (24)` for several."""
    return group.name if len(group.places) == 1 else f"{group.name} ({len(group.places)})"


def group_value(network: MassSpringNetwork, group: ConstantGroup) -> float:
    """Geometric mean of the group's constants, in SI units."""
    return float(np.exp(np.mean([np.log(parameter_value(network, one)) for one in group.parameters])))


def _shares(kind: str, group: ConstantGroup) -> bool:
    return group.kind == kind and len(group.places) > 1


def _drawn_lengths(network: MassSpringNetwork) -> Floats:
    i, j = network.springs.T
    return np.asarray(np.linalg.norm(network.positions[j] - network.positions[i], axis=1))


def _spring_names(network: MassSpringNetwork, spring_groups: Sequence[str]) -> dict[int, str]:
    n = len(network.springs)
    if any(spring_groups):
        return {s: name for s, name in enumerate(spring_groups) if name}
    if n <= MOST_SINGLE:
        return {}
    kinds = [f"{value:.{SAME_DIGITS}g} N/m" for value in network.stiffness]
    return dict(enumerate(kinds if len(set(kinds)) <= MOST_SINGLE else ["all springs"] * n))


def _node_names(network: MassSpringNetwork, own: Sequence[Parameter]) -> dict[int, str]:
    if len(own) <= MOST_SINGLE:
        return {}
    kinds = {one.index: f"{parameter_value(network, one):.{SAME_DIGITS}g}" for one in own}
    return kinds if len(set(kinds.values())) <= MOST_SINGLE else dict.fromkeys(kinds, "all nodes")
