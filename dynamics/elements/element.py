"""Protocol of a kind of force element."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dynamics.arrays import Floats


class ForceElement(Protocol):
    """Protocol of a force element. One object contains all elements of its kind.

    Attributes
    ----------
    nodes : (n_elements, n_corners) int
        The nodes of each element.

    Notes
    -----
    In all methods, `x` and `v` are positions [m] and velocities [m/s] of the corners, (n_elements, n_corners, dim).
    """

    @property
    def nodes(self) -> NDArray[np.int64]:
        """Nodes of each element, (n_elements, n_corners)."""

    def energy(self, x: Floats) -> Floats:
        """Potential energy of each element [J], (n_elements,)."""

    def force(self, x: Floats, v: Floats) -> Floats:
        """Force on each corner [N], (n_elements, n_corners, dim)."""

    def tangents(self, x: Floats, v: Floats) -> tuple[Floats, Floats]:
        """Minus the derivatives of the force with respect to positions [N/m] and velocities [N s/m].

        Each has the shape (n_elements, n_corners, dim, n_corners, dim).
        """

    def by_log_constants(self, x: Floats, v: Floats) -> Mapping[str, Floats]:
        """Derivative of the force with respect to the log of each kind of constant [N], shaped as `force`."""
