"""A moving body: its network, its visible nodes, and the true positions of all nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynamics import MassSpringNetwork
from experiments.arrays import Floats

GRAVITY_M_S2 = 9.81

MARK_SD_M = 0.5e-3
"""Standard deviation of a mark on each axis [m], for a body with the size factor 1; it scales with the size factor."""


@dataclass(frozen=True, slots=True)
class Scale:
    """Factors on a body's size, stiffness and mass. Gravity, duration and frame rate do not change.

    If only the size changes, masses scale with the cube and spring constants with the square of the size. The sag
    relative to the size then does not change. Dashpot constants scale so that damping ratios do not change.
    """

    size: float = 1.0
    stiffness: float = 1.0
    mass: float = 1.0

    @property
    def k(self) -> float:
        """Factor on spring constants [1]."""
        return self.stiffness * self.size**2

    @property
    def m(self) -> float:
        """Factor on masses [1]."""
        return self.mass * self.size**3

    @property
    def c(self) -> float:
        """Factor on dashpot constants [1]."""
        return float(np.sqrt(self.k * self.m))

    @property
    def oscillation(self) -> float:
        """Factor on the period of elastic oscillations [1]."""
        return float(np.sqrt(self.m / self.k))

    @property
    def swing(self) -> float:
        """Factor on the period of a pendulum [1]."""
        return float(np.sqrt(self.size))


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A moving body: its true motion, and the network with which a user models it.

    network: the user's network with the best-known constants, in the shape that a user would draw
    times_s: times of the frames [s], (n_frames,)
    positions: true positions of the nodes [m], (n_frames, n_nodes, dim)
    marked: names of the visible nodes; mark_sd_m: standard deviation of a mark on each axis [m]
    at_rest: whether rest lengths follow from the drawn shape, because the body is at rest in it
    in_line: whether the nodes form a line, in their order
    led: marked nodes that the simulation moves along a path
    kinds: the kind of each spring. Identification finds a factor for each kind; if `kinds` is empty, for each spring.
    """

    network: MassSpringNetwork
    times_s: Floats
    positions: Floats
    marked: tuple[str, ...]
    mark_sd_m: float
    at_rest: bool = False
    in_line: bool = False
    led: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()

    @property
    def hidden(self) -> tuple[str, ...]:
        """Names of the free nodes that are never visible."""
        names = (self.network.names[i] for i in self.network.free)
        return tuple(name for name in names if name not in self.marked)

    @property
    def size_m(self) -> float:
        """Largest distance between two nodes in the drawn shape [m]."""
        places = self.network.positions
        return float(np.linalg.norm(places[:, None] - places[None], axis=2).max())


def node_names(n: int) -> tuple[str, ...]:
    """Names of n nodes."""
    return tuple(f"n{i}" for i in range(n))
