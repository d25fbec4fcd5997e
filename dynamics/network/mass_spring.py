"""Mass-spring networks, checked at construction: the model of the tissue."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynamics.arrays import Floats, made_again
from dynamics.network.continuum import Continuum

NODE_CONSTANTS = {"drag": "0 or more", "friction": "0 or more"}
"""Fields with one constant for each node, and their permitted values."""

SPRING_CONSTANTS = {"stiffness": "more than 0", "rest_lengths": "more than 0", "damping": "0 or more"}
"""Fields with one constant for each spring, and their permitted values."""


class NetworkError(ValueError):
    """Error for a network that cannot be simulated. The message names the field, the expected and the found value."""


@dataclass(frozen=True, slots=True, eq=False)
class MassSpringNetwork:
    """Point masses joined by springs with dashpots, in the plane or in space.

    names: unique names of the n_nodes nodes
    positions: position of each node in the drawn shape [m], shape (n_nodes, dim), dim 2 or 3
    masses: mass of each node [kg], shape (n_nodes,), positive; the mass of an anchor is not used
    fixed: True for an anchor, shape (n_nodes,)
    drag: viscous friction against the ground [N s/m], shape (n_nodes,)
    friction: Coulomb friction against the planes that hold the node [N], shape (n_nodes,)
    springs: the two nodes of each spring, shape (n_springs, 2)
    stiffness: stiffness of each spring [N/m], shape (n_springs,), positive
    rest_lengths: rest length of each spring [m], shape (n_springs,), positive
    damping: damping of the dashpot along each spring [N s/m], shape (n_springs,)
    gravity: acceleration [m/s²], shape (dim,)
    continuum: a solid in place of springs, whose points are the free nodes; None for a network of springs

    Raises NetworkError for values that cannot be simulated.
    """

    names: tuple[str, ...]
    positions: Floats
    masses: Floats
    fixed: NDArray[np.bool_]
    drag: Floats
    friction: Floats
    springs: NDArray[np.int64]
    stiffness: Floats
    rest_lengths: Floats
    damping: Floats
    gravity: Floats
    continuum: Continuum | None = None
    free: NDArray[np.int64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        n_nodes, n_springs = len(self.names), len(_pairs(self.springs))
        dim = np.asarray(self.positions).shape[-1] if np.ndim(self.positions) == 2 else 0
        if dim not in (2, 3):
            raise NetworkError(
                f"positions: expected shape (n_nodes, 2) or (n_nodes, 3), found {np.shape(self.positions)}"
            )
        shapes = {
            "positions": (n_nodes, dim),
            "masses": (n_nodes,),
            "gravity": (dim,),
            **dict.fromkeys(NODE_CONSTANTS, (n_nodes,)),
            **dict.fromkeys(SPRING_CONSTANTS, (n_springs,)),
        }
        for key, shape in shapes.items():
            object.__setattr__(self, key, _frozen(key, getattr(self, key), shape))
        object.__setattr__(self, "fixed", np.array(self.fixed, dtype=bool))
        object.__setattr__(self, "springs", _pairs(self.springs))
        object.__setattr__(self, "free", np.flatnonzero(~self.fixed))
        self._check_nodes()
        self._check_springs()
        if self.continuum is not None and len(self.continuum.shapes) != len(self.free) * dim:
            raise NetworkError(
                f"continuum: expected shapes of {len(self.free) * dim} coordinates, found {len(self.continuum.shapes)}"
            )
        if self.continuum is not None and n_springs:
            raise NetworkError(f"continuum: expected no springs beside it, found {n_springs}")
        for key in ("fixed", "springs", "free"):
            getattr(self, key).setflags(write=False)

    @property
    def is_held(self) -> bool:
        """Whether anchors hold the body in place; False if the anchors are a wall that moves in an unknown way."""
        return bool(self.fixed.any()) and (self.continuum is None or bool(np.isfinite(self.continuum.masses).all()))

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return made_again(self)

    def _check_nodes(self) -> None:
        seen: set[str] = set()
        for name in self.names:
            if name in seen:
                raise NetworkError(f'node "{name}": expected unique names, found it twice')
            seen.add(name)
        if self.fixed.shape != (len(self.names),):
            raise NetworkError(f"fixed: expected shape {(len(self.names),)}, found {self.fixed.shape}")
        if not len(self.free):
            raise NetworkError("fixed: expected at least one free node, found none")
        attached = set(self.springs.ravel().tolist())
        for i, name in enumerate(self.names):
            if not self.fixed[i] and self.masses[i] <= 0:
                raise NetworkError(f'node "{name}" mass: expected more than 0 kg, found {self.masses[i]:g}')
            if not self.fixed[i] and i not in attached and self.continuum is None:
                raise NetworkError(f'node "{name}": expected at least one spring, found none')
            self._check_constants(NODE_CONSTANTS, i, f'node "{name}"')

    def _check_springs(self) -> None:
        n_nodes = len(self.names)
        for s, (i, j) in enumerate(self.springs):
            if not (0 <= i < n_nodes and 0 <= j < n_nodes):
                raise NetworkError(f"spring {s}: expected nodes 0 to {n_nodes - 1}, found {i} and {j}")
            label = f"spring {self.names[i]}-{self.names[j]}"
            if i == j:
                raise NetworkError(f"{label}: expected two different nodes, found one")
            self._check_constants(SPRING_CONSTANTS, s, label)
            if np.array_equal(self.positions[i], self.positions[j]):
                raise NetworkError(
                    f"{label}: expected its nodes at different places, found both at {self.positions[i]} m"
                )

    def _check_constants(self, allowed: Mapping[str, str], i: int, label: str) -> None:
        for key, expected in allowed.items():
            value = getattr(self, key)[i]
            if value < 0 or (value == 0 and expected == "more than 0"):
                raise NetworkError(f"{label} {key}: expected {expected}, found {value:g}")

    @property
    def dim(self) -> int:
        """Dimension: 2 in the plane, 3 in space."""
        return int(self.positions.shape[1])

    @property
    def n_nodes(self) -> int:
        """Number of nodes, including anchors."""
        return len(self.names)

    @property
    def n_state(self) -> int:
        """Length of a state, which contains the positions, then the velocities of the free nodes."""
        return 2 * len(self.free) * self.dim

    def index(self, name: str) -> int:
        """Index of the node with a given name among all nodes; NetworkError if there is none."""
        if name not in self.names:
            raise NetworkError(f'no node named "{name}"')
        return self.names.index(name)

    def coordinates(self, name: str) -> slice:
        """Slice of a state vector with the coordinates of a free node; NetworkError for an anchor."""
        place = np.flatnonzero(self.free == self.index(name))
        if not len(place):
            raise NetworkError(f'node "{name}": expected a free node, found an anchor')
        start = int(place[0]) * self.dim
        return slice(start, start + self.dim)


def _frozen(key: str, value: ArrayLike, shape: tuple[int, ...]) -> Floats:
    array = np.array(value, dtype=np.float64, order="C")
    if array.shape != shape:
        raise NetworkError(f"{key}: expected shape {shape}, found {array.shape}")
    if not np.isfinite(array).all():
        raise NetworkError(f"{key}: expected finite numbers, found {array[~np.isfinite(array)][0]}")
    array.setflags(write=False)
    return array


def _pairs(springs: ArrayLike) -> NDArray[np.int64]:
    pairs = np.array(springs)
    if pairs.size == 0:
        return np.empty((0, 2), dtype=np.int64)
    if pairs.ndim != 2 or pairs.shape[1] != 2 or pairs.dtype.kind not in "iu":
        raise NetworkError(
            f"springs: expected whole numbers of shape (n_springs, 2), found {pairs.dtype} {pairs.shape}"
        )
    return pairs.astype(np.int64, order="C")


def pack(positions: ArrayLike, velocities: ArrayLike) -> Floats:
    """State vectors [m, m/s], (..., 2 n dim), from positions [m] and velocities [m/s] of the free nodes, (..., n, dim).

    Node-major: x0 y0 x1 y1 ... vx0 vy0 ...
    """
    x, v = np.asarray(positions, dtype=float), np.asarray(velocities, dtype=float)
    if x.shape != v.shape or x.ndim < 2:
        raise ValueError(f"expected positions and velocities of one shape (..., n, dim), found {x.shape}, {v.shape}")
    lead = x.shape[:-2]
    return np.concatenate([x.reshape(*lead, -1), v.reshape(*lead, -1)], axis=-1)


def unpack(states: ArrayLike, dim: int) -> tuple[Floats, Floats]:
    """Positions [m] and velocities [m/s] of the free nodes, each (..., n, dim), from states (..., 2 n dim)."""
    s = np.asarray(states, dtype=float)
    n, rest = divmod(s.shape[-1], 2 * dim)
    if rest:
        raise ValueError(f"expected states of length 2 n {dim}, found {s.shape[-1]}")
    shape = (*s.shape[:-1], n, dim)
    return s[..., : n * dim].reshape(shape), s[..., n * dim :].reshape(shape)


def spring_lengths(positions: Floats, springs: NDArray[np.int64]) -> Floats:
    """Distance between the two nodes of each spring [m], (n_springs,).

    positions: positions of all nodes [m], (n_nodes, dim); springs: the two nodes of each spring, (n_springs, 2)
    """
    return np.asarray(np.linalg.norm(positions[springs[:, 1]] - positions[springs[:, 0]], axis=1))


def all_positions(network: MassSpringNetwork, free_positions: Floats) -> Floats:
    """Positions of all nodes [m], (n_nodes, dim), from positions of the free nodes [m], (n_free, dim)."""
    positions = network.positions.copy()
    positions[network.free] = free_positions
    return positions
