"""Construction of a network from names, positions and edges."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynamics.arrays import Floats
from dynamics.equilibrium.rest import fit_rest_lengths
from dynamics.network.mass_spring import MassSpringNetwork, NetworkError, spring_lengths

AT_REST, AS_DRAWN = "at rest", "as drawn"

MISSED = 1e-4
"""A network rests as drawn if no node is further from its drawn position than this share of the longest spring; choice:
0.01 mm for a spring of 100 mm. In phantoms, rounding errors are 1e-14 of the longest spring."""


def build_network(
    names: Sequence[str],
    positions: ArrayLike,
    edges: Sequence[tuple[str | int, str | int]],
    *,
    stiffness: ArrayLike,
    masses: ArrayLike,
    gravity: ArrayLike,
    fixed: Collection[str] = (),
    damping: ArrayLike = 0.0,
    drag: ArrayLike = 0.0,
    friction: ArrayLike = 0.0,
    rest_lengths: ArrayLike | Literal["at rest", "as drawn"] = "at rest",
) -> MassSpringNetwork:
    """Build a network of these nodes, with a spring along each edge.

    names: unique names of the n_nodes nodes
    positions: positions of the nodes in the drawn shape [m], (n_nodes, dim), dim 2 or 3
    edges: the two nodes of each of n_springs springs, as names or as indices into `names`; each pair at most once
    stiffness, damping: stiffness of the springs [N/m], damping of the springs' dashpots [N s/m]
    masses, drag, friction: mass [kg], viscous drag [N s/m] and Coulomb friction [N] of the nodes
    gravity: acceleration [m/s²], (dim,); zeros for a body that lies flat
    fixed: names of the anchors
    rest_lengths: lengths [m]; or "as drawn": lengths in the drawn shape, so that the network sags under gravity;
        or "at rest": lengths that differ slightly from those in the drawn shape, so that the network rests as drawn

    Each constant is one number for all springs or nodes, or an array in their order, (n_springs,) or (n_nodes,).
    Raises NetworkError for invalid arguments, and if small changes of rest lengths cannot balance the drawn shape.
    """
    known = _places(names)
    x = _numbers("positions", positions)
    if x.ndim != 2 or len(x) != len(known):
        raise NetworkError(f"positions: expected one for each of {len(known)} nodes, found shape {x.shape}")
    springs = _springs(edges, known)
    if isinstance(fixed, str):
        raise NetworkError(f'fixed: expected a list of names, found the text "{fixed}"')
    for name in fixed:
        if name not in known:
            raise NetworkError(f'fixed: no node named "{name}"')
    n_nodes, n_springs = len(known), len(springs)
    lengths: ArrayLike = spring_lengths(x, springs)
    if not isinstance(rest_lengths, str):
        lengths = _each("rest_lengths", rest_lengths, n_springs, "edges")
    elif rest_lengths not in (AT_REST, AS_DRAWN):
        raise NetworkError(f'rest_lengths: expected "{AT_REST}", "{AS_DRAWN}" or numbers, found "{rest_lengths}"')
    network = MassSpringNetwork(
        names=tuple(known),
        positions=x,
        masses=_each("masses", masses, n_nodes, "nodes"),
        fixed=np.array([name in fixed for name in known]),
        drag=_each("drag", drag, n_nodes, "nodes"),
        friction=_each("friction", friction, n_nodes, "nodes"),
        springs=springs,
        stiffness=_each("stiffness", stiffness, n_springs, "edges"),
        rest_lengths=np.asarray(lengths),
        damping=_each("damping", damping, n_springs, "edges"),
        gravity=_numbers("gravity", gravity),
    )
    # without an anchor the network has no weight, and rests as drawn
    if isinstance(rest_lengths, str) and rest_lengths == AT_REST and network.fixed.any() and network.gravity.any():
        return _at_rest(network)
    return network


def _at_rest(network: MassSpringNetwork) -> MassSpringNetwork:
    fitted = fit_rest_lengths(network, network.positions)
    missed = np.linalg.norm(fitted.positions - network.positions, axis=1)
    if missed.max() > MISSED * float(network.rest_lengths.max()):
        name = network.names[int(missed.argmax())]
        raise NetworkError(
            f'node "{name}": expected springs that let it rest where it is drawn, '
            f"found its rest {1e3 * missed.max():.3g} mm away"
        )
    return fitted


def _places(names: Sequence[str]) -> dict[str, int]:
    if isinstance(names, str):
        raise NetworkError(f'names: expected a list of names, found the text "{names}"')
    places: dict[str, int] = {}
    for i, name in enumerate(names):
        if not isinstance(name, str):
            raise NetworkError(f"names[{i}]: expected a text, found {name!r}")
        if name in places:
            raise NetworkError(
                f'node "{name}": expected unique names, found it as names[{places[name]}] and names[{i}]'
            )
        places[name] = i
    return places


def _springs(edges: Sequence[tuple[str | int, str | int]], places: dict[str, int]) -> NDArray[np.int64]:
    pairs: dict[frozenset[int], int] = {}
    springs = np.empty((len(edges), 2), dtype=np.int64)
    for s, edge in enumerate(edges):
        ends = [edge] if isinstance(edge, str) or not isinstance(edge, Iterable) else list(edge)
        label = f"edges[{s}] ({'-'.join(map(str, ends))})"
        if len(ends) != 2:
            raise NetworkError(f"{label}: expected two nodes, found {len(ends)}")
        springs[s] = [_place(label, end, places) for end in ends]
        if springs[s, 0] == springs[s, 1]:
            raise NetworkError(f"{label}: expected two different nodes, found one")
        first = pairs.setdefault(frozenset(springs[s].tolist()), s)
        if first != s:
            raise NetworkError(f"{label}: expected each pair once, found it as edges[{first}], too")
    return springs


def _place(label: str, end: str | int, places: dict[str, int]) -> int:
    if isinstance(end, str):
        if end not in places:
            raise NetworkError(f'{label}: no node named "{end}"')
        return places[end]
    if isinstance(end, (bool, np.bool_)) or not isinstance(end, (int, np.integer)):
        raise NetworkError(f"{label}: expected the name or the place of a node, found {end!r}")
    if not 0 <= end < len(places):
        raise NetworkError(f"{label}: expected nodes 0 to {len(places) - 1}, found {end}")
    return int(end)


def _each(key: str, values: ArrayLike, n: int, what: str) -> Floats:
    """Array of n values, from n values or from one value for all. Raises NetworkError for another number of values."""
    array = _numbers(key, values)
    if array.shape not in ((), (n,)):
        raise NetworkError(f"{key}: expected one number or one for each of {n} {what}, found shape {array.shape}")
    return np.broadcast_to(array, (n,))


def _numbers(key: str, values: ArrayLike) -> Floats:
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise NetworkError(f"{key}: expected numbers, found {values!r}") from None
