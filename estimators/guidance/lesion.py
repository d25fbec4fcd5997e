"""Lesion around the target: a ball or an ellipsoid that moves with the target, in the plane or in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Lesion:
    """A lesion around the target: the ellipsoid of all points x with ‖axes⁻¹ (x - target)‖ <= 1.

    axes: matrix whose columns are the semi-axes [m], (dim, dim); for a ball, the identity times the radius
    Raises ValueError if the semi-axes are linearly dependent.
    """

    axes: Floats

    def __post_init__(self) -> None:
        axes = np.asarray(self.axes, dtype=float)
        if axes.shape not in ((2, 2), (3, 3)):
            raise ValueError(f"lesion axes: expected shape (2, 2) or (3, 3), found {axes.shape}")
        sizes = np.linalg.svd(axes, compute_uv=False) if np.isfinite(axes).all() else np.zeros(1)
        if not sizes[-1] > 1e-9 * sizes[0]:
            raise ValueError(f"lesion axes: expected finite ones that span {len(axes)} dimensions, found {axes}")

    @classmethod
    def ball(cls, radius_m: float, dim: int) -> Lesion:
        """A disc (dim 2) or a ball (dim 3) of this radius [m]."""
        if not 0.0 < radius_m < np.inf:
            raise ValueError(f"lesion radius: expected more than 0 m, found {radius_m}")
        return cls(radius_m * np.eye(dim))

    @property
    def dim(self) -> int:
        """Dimension of the lesion's space."""
        return len(self.axes)

    @property
    def radius_m(self) -> float:
        """Radius of the ball that has the lesion's volume [m]."""
        sizes = np.linalg.svd(self.axes, compute_uv=False)
        return float(sizes[0] if sizes[0] == sizes[-1] else np.exp(np.log(sizes).mean()))

    @property
    def to_ball(self) -> Floats:
        """Linear map that turns the lesion into the unit ball [1/m], (dim, dim)."""
        return np.ascontiguousarray(np.linalg.inv(self.axes))

    def contains(self, offsets: Floats) -> NDArray[np.bool_]:
        """Whether points lie in the lesion, (n,); offsets: points relative to the target [m], (n, dim)."""
        return (np.square(offsets @ self.to_ball.T)).sum(axis=1) <= 1.0

    def core_lengths(self, offsets: Floats, axis: Floats, length_m: float) -> Floats:
        """Length of each of n parallel segments inside the lesion [m], (n,).

        offsets: middles of the segments relative to the target [m], (n, dim)
        axis: unit vector along all segments, (dim,); length_m: common length of the segments [m]
        """
        x, w = offsets @ self.to_ball.T, self.to_ball @ axis
        squared = w @ w
        nearest = -(x @ w) / squared  # along the axis from the middle [m]
        half = np.sqrt(np.maximum(0.0, nearest**2 - ((x**2).sum(axis=1) - 1.0) / squared))
        low = np.maximum(nearest - half, -0.5 * length_m)
        return np.maximum(0.0, np.minimum(nearest + half, 0.5 * length_m) - low)
