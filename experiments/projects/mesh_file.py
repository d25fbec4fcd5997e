"""Spring meshes of a user: `nodes.csv` and `springs.csv`. If springs.csv is missing, a triangulation gives the springs.

nodes.csv    name,x_mm,y_mm[,z_mm][,mass_kg][,fixed][,hue_deg][,target]    fixed, target: yes, or empty
springs.csv  from,to[,stiffness_N_m][,damping_N_s_m][,group]
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynamics import NetworkError, Phantom, elastic_body, on_hull, spring_lengths
from dynamics.phantoms.lattice import volume
from experiments.arrays import Floats
from experiments.errors import InputError, no_node, placed, shown
from experiments.formats.scene.network import is_node_name
from experiments.formats.tables import Table, read_rows, read_table

YES = ("yes", "")
"""Permitted entries in columns `fixed` and `target`."""

SHORTEST_M = 4e-4
"""Shortest permitted spring [m]. A mark's diameter is a sixth of the shortest spring, is rounded to 0.1 mm and must not
become 0. Shorter springs are usually due to lengths in metres."""


def read_mesh(nodes: Path, springs: Path | None, young: float) -> tuple[Phantom, dict[str, float]]:
    """The body in these files, and the hues of marks that the files state, by node [degrees]. Raises InputError.

    Stiffnesses follow from `young` [Pa] unless the files state them.
    """
    has = next(read_rows(nodes, "columns x_mm, y_mm, name"))
    axes = ["x_mm", "y_mm", *(["z_mm"] if "z_mm" in has else [])]
    texts = ["name", *(key for key in ("fixed", "hue_deg", "target") if key in has)]
    table = read_table(nodes, [*axes, *(["mass_kg"] if "mass_kg" in has else [])], texts)
    names = table.texts["name"]
    table.check("name", np.array([names.index(name) == i for i, name in enumerate(names)]), "a unique name")
    table.check("name", np.array([bool(name) for name in names]), "a name")
    table.check("name", np.array([is_node_name(name) for name in names]), "a name that prints on one line")
    fixed, target = _yes(table, "fixed"), _yes(table, "target")
    if (~fixed).sum() < 2:
        raise InputError.at(nodes, "two or more free nodes: a target and one with a mark", str(int((~fixed).sum())))
    masses = table.numbers.get("mass_kg")
    if masses is not None:
        table.check("mass_kg", (masses > 0.0) | fixed, "more than 0")
    positions = 1e-3 * np.stack([table.numbers[axis] for axis in axes], axis=1)
    with placed(nodes, NetworkError):
        volume(positions)
    hues = _hues(table, fixed) if "hue_deg" in has else {}
    chosen = _target(table, target, fixed, positions)
    outer = [name for name in hues if name != chosen] or _outside(names, positions, fixed, chosen)
    joined, pairs = (None, None) if springs is None else _springs(springs, names)
    given = {} if joined is None else joined.numbers
    try:
        network = elastic_body(
            names,
            positions,
            fixed,
            young,
            springs=pairs,
            stiffness=given.get("stiffness_N_m"),
            damping=given.get("damping_N_s_m"),
            masses=masses,
        )
    except NetworkError as error:
        fault = f"{nodes if springs is None else springs}: {error}"
        raise InputError(f"{fault}; a stiffer body (--young-kpa), braces or less mass may hold it") from None
    shortest_m = float(spring_lengths(positions, network.springs).min())
    if shortest_m < SHORTEST_M:
        raise InputError.at(nodes, f"springs of {1e3 * SHORTEST_M:g} mm or more", f"one of {1e3 * shortest_m:.2g} mm")
    groups = (joined.texts if joined is not None else {}).get("group", ["springs"] * len(network.springs))
    return Phantom(network, chosen, tuple(outer), tuple(groups)), hues


def _yes(table: Table, column: str) -> NDArray[np.bool_]:
    entries = table.texts.get(column, [""] * table.n_rows)
    if column in table.texts:
        table.check(column, np.array([entry in YES for entry in entries]), "yes or no entry")
    return np.array([entry == "yes" for entry in entries])


def _hues(table: Table, fixed: NDArray[np.bool_]) -> dict[str, float]:
    hues: dict[str, float] = {}
    for row, (name, entry) in enumerate(zip(table.texts["name"], table.texts["hue_deg"], strict=True)):
        if not entry:
            continue
        try:
            hue = float(entry)
        except ValueError:
            hue = np.nan
        if not 0.0 <= hue < 360.0:
            raise InputError.at(table.place(row, "hue_deg"), "0 or more and less than 360, or no entry", shown(entry))
        if fixed[row]:
            raise InputError.at(
                table.place(row, "hue_deg"), "no entry for an anchor, whose mark has no information", entry
            )
        hues[name] = hue
    return hues


def _target(table: Table, target: NDArray[np.bool_], fixed: NDArray[np.bool_], positions: Floats) -> str:
    """The target node that the file states; by default, the free node nearest to the centre of all free nodes."""
    if target.sum() > 1:
        raise InputError.at(table.place(int(np.flatnonzero(target)[1]), "target"), "one target", "a second one")
    free = np.flatnonzero(~fixed)
    row = int(target.argmax())
    if not target.any():
        middle = positions[free].mean(axis=0)
        row = int(free[np.linalg.norm(positions[free] - middle, axis=1).round(9).argmin()])
    if fixed[row]:
        raise InputError.at(table.place(row, "target"), "no entry for an anchor, which does not move", "yes")
    return table.texts["name"][row]


def _outside(names: Sequence[str], positions: Floats, fixed: NDArray[np.bool_], target: str) -> list[str]:
    """Free nodes except the target: those at corners of the convex hull; if there are none, all free nodes."""
    free = [name for name, one in zip(names, fixed, strict=True) if not one and name != target]
    corners = {name for name, one in zip(names, on_hull(positions), strict=True) if one}
    return [name for name in free if name in corners] or free


def _springs(path: Path, names: Sequence[str]) -> tuple[Table, NDArray[np.int64]]:
    """The table springs.csv, and the pair of nodes of each spring, (n_springs, 2)."""
    has = next(read_rows(path, "columns from, to"))
    numbers = [key for key in ("stiffness_N_m", "damping_N_s_m") if key in has]
    table = read_table(path, numbers, ["from", "to", *(["group"] if "group" in has else [])])
    if not table.n_rows:
        raise InputError.at(path, "a row for each spring", "none")
    places = {name: i for i, name in enumerate(names)}
    for end in ("from", "to"):
        for row, name in enumerate(table.texts[end]):
            if name not in places:
                raise InputError(f"{table.place(row, end)}: {no_node(name, names)}")
    ends = [frozenset(pair) for pair in zip(table.texts["from"], table.texts["to"], strict=True)]
    table.check("to", np.array([len(pair) == 2 for pair in ends]), "another node than in from")
    table.check("to", np.array([ends.index(pair) == s for s, pair in enumerate(ends)]), "each pair once")
    if "stiffness_N_m" in has:
        table.check("stiffness_N_m", table.numbers["stiffness_N_m"] > 0.0, "more than 0")
    if "damping_N_s_m" in has:
        table.check("damping_N_s_m", table.numbers["damping_N_s_m"] >= 0.0, "0 or more")
    pairs = np.array([[places[name] for name in table.texts[end]] for end in ("from", "to")], dtype=np.int64).T
    return table, pairs
