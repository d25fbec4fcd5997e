"""`[network]` of a scene file: reading and writing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dynamics import MassSpringNetwork, NetworkError, reaches
from experiments.arrays import Floats
from experiments.errors import no_node, shown
from experiments.formats.scene.schema import NODE_KEYS, SPRING_KEYS, NetworkTable, NodeTable, SceneError, check_dim
from experiments.formats.toml_file import Strict, key_lines

NEAREST_MM = 1e-4
"""Least length of a spring [mm] in the drawn shape; choice: less than the accuracy of any drawing."""


def is_node_name(name: str) -> bool:
    """Whether a name is valid: printable on one line, without surrounding spaces."""
    return bool(name) and name.isprintable() and name == name.strip()


def check_name(key: str, name: str) -> None:
    """Raise SceneError for an invalid name of a node or mark."""
    if not is_node_name(name):
        raise SceneError(f"{key}: expected a name that prints on one line, found {shown(name)}")


def network_of(table: NetworkTable) -> MassSpringNetwork:
    """The network of a table; raises SceneError, `network…: …`, for the first fault."""
    indices: dict[str, int] = {}
    for i, node in enumerate(table.node):
        _check_node(table, i, node)
        if node.name in indices:
            raise SceneError(
                f"network.node[{i}].name: expected a unique name,"
                f" found {shown(node.name)}, that of network.node[{indices[node.name]}]"
            )
        indices[node.name] = i
    if all(node.fixed for node in table.node):
        raise SceneError("network.node: expected one or more free nodes, found none")
    springs = [_ends(table, s, indices) for s in range(len(table.spring))]
    attached = {i for ends in springs for i in ends}
    for i, node in enumerate(table.node):
        if not node.fixed and i not in attached:
            raise SceneError(f"network.node[{i}]: expected one or more springs to {shown(node.name)}, found none")
    try:
        of_nodes, of_springs = _constants(table.node, NODE_KEYS), _constants(table.spring, SPRING_KEYS)
        network = MassSpringNetwork(
            names=tuple(indices),
            positions=1e-3 * np.array([node.position_mm for node in table.node]),
            masses=np.array([node.mass_kg or 0.0 for node in table.node]),
            fixed=np.array([node.fixed for node in table.node]),
            drag=of_nodes["drag"],
            friction=of_nodes["friction"],
            springs=np.array(springs, dtype=np.int64),
            stiffness=of_springs["stiffness"],
            rest_lengths=of_springs["rest_lengths"],
            damping=of_springs["damping"],
            gravity=np.array(table.gravity_m_s2),
        )
    except NetworkError as error:
        raise SceneError(f"network: {error}") from None
    for i in np.flatnonzero(~np.isfinite(reaches(network))).tolist():
        expected = "springs that lead to an anchor" if network.fixed.any() else "springs that lead to every other node"
        raise SceneError(f"network.node[{i}]: expected {expected}, found none from {shown(network.names[i])}")
    return network


def spring_groups(table: NetworkTable) -> tuple[str, ...]:
    """The name of each spring's group, (n_springs,); constants of one group are identified together.

    The name is empty for a spring without a group. The tuple is empty if no spring has a group.
    """
    groups = tuple(spring.group or "" for spring in table.spring)
    return groups if any(groups) else ()


def _constants(tables: Sequence[Strict], keys: Mapping[str, tuple[str, float]]) -> dict[str, Floats]:
    return {field: si * np.array([getattr(table, key) for table in tables]) for key, (field, si) in keys.items()}


def _check_node(table: NetworkTable, i: int, node: NodeTable) -> None:
    if node.mass_kg is None and not node.fixed:
        raise SceneError(f"network.node[{i}].mass_kg: expected this key for a free node, found none")
    if node.mass_kg is not None and (node.mass_kg < 0 or (node.mass_kg == 0 and not node.fixed)):
        expected = "0 or more" if node.fixed else "more than 0"
        raise SceneError(f"network.node[{i}].mass_kg: expected {expected}, found {shown(node.mass_kg)}")
    check_dim(f"network.node[{i}].position_mm", node.position_mm, len(table.gravity_m_s2))


def _ends(table: NetworkTable, s: int, indices: dict[str, int]) -> tuple[int, int]:
    key, between = f"network.spring[{s}].between", table.spring[s].between
    for name in between:
        if name not in indices:
            raise SceneError(f"{key}: {no_node(name, indices)}")
    i, j = (indices[name] for name in between)
    if i == j:
        raise SceneError(f"{key}: expected two different nodes, found {shown(between)}")
    if math.dist(table.node[i].position_mm, table.node[j].position_mm) < NEAREST_MM:
        raise SceneError(
            f"{key}: expected nodes at different places, found both at {shown(table.node[i].position_mm)} mm"
        )
    return i, j


def network_lines(network: MassSpringNetwork, groups: Sequence[str] = ()) -> list[str]:
    """Lines of `[network]`. `groups` has the name of each spring's group, see `spring_groups`."""
    lines = ["[network]", *key_lines({"gravity_m_s2": network.gravity})]
    for i, name in enumerate(network.names):
        keys: dict[str, Any] = {
            "name": name,
            # rounded to 1e-12 m, so that rounding errors of rest shapes become zero; adding 0.0 turns -0.0 into 0.0
            "position_mm": np.round(1e3 * network.positions[i], 9) + 0.0,
            "mass_kg": None if network.fixed[i] and network.masses[i] == 0 else network.masses[i],
        }
        lines += ["", "[[network.node]]", *key_lines({**keys, **_si(network, i, NODE_KEYS), "fixed": network.fixed[i]})]
    for s, (i, j) in enumerate(network.springs):
        keys = {"between": [network.names[i], network.names[j]], **_si(network, s, SPRING_KEYS)}
        keys["group"] = (groups[s] if groups else "") or None
        lines += ["", "[[network.spring]]", *key_lines(keys)]
    return lines


def _si(network: MassSpringNetwork, i: int, keys: Mapping[str, tuple[str, float]]) -> dict[str, float]:
    """Constants of a node or spring in the units of the keys."""
    return {key: (1.0 / si) * getattr(network, field)[i] for key, (field, si) in keys.items()}
