"""Rigid motions `p = R (x - c) + c + t` in the plane and in space, and small changes of a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats

GENERATORS = {
    2: np.array([[[0.0, -1.0], [1.0, 0.0]]]),
    3: np.array(
        [
            [[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]],
            [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]],
            [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
        ]
    ),
}
"""Generators G of the rotations by dimension, (dim (dim - 1) / 2, dim, dim). `exp(a G)` is a rotation by a [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class RigidMotion:
    """Rigid motion that maps a point x [m] to `R (x - c) + c + t` [m].

    rotation: R, (dim, dim); translation: t [m], (dim,); centre: c [m], (dim,)
    A small change is a vector (n,): translation [m], then rotation [rad]. The small rotation is applied after R.
    """

    rotation: Floats
    translation: Floats
    centre: Floats

    @classmethod
    def none(cls, centre: Floats) -> RigidMotion:
        """The identity. Later changes rotate about the point `centre` [m], (dim,)."""
        return cls(np.eye(len(centre)), np.zeros(len(centre)), centre)

    def moved(self, points_m: Floats) -> Floats:
        """Points after the motion [m], (k, dim)."""
        return np.asarray((points_m - self.centre) @ self.rotation.T + self.centre + self.translation)

    def back(self, points_m: Floats) -> Floats:
        """Inverse of `moved`: positions of the points before the motion [m], (k, dim)."""
        return np.asarray((points_m - self.centre - self.translation) @ self.rotation + self.centre)

    def change_of(self, moved_m: Floats) -> Floats:
        """Derivative (k, dim, n) of the moved points [m], (k, dim), with respect to a small change of the motion."""
        arms = moved_m - self.centre - self.translation
        turned = np.einsum("aij,kj->kia", GENERATORS[len(self.centre)], arms)
        return np.concatenate([np.broadcast_to(np.eye(len(self.centre)), (len(arms), *self.rotation.shape)), turned], 2)

    def changed(self, change: Floats) -> RigidMotion:
        """The motion after a small change (n,), see `RigidMotion`."""
        dim = len(self.centre)
        angle = float(np.linalg.norm(change[dim:]))
        turn = np.eye(dim)
        if angle > 0.0:  # Rodrigues' formula
            axis = sum(a * G for a, G in zip(change[dim:] / angle, GENERATORS[dim], strict=True))
            turn = turn + np.sin(angle) * axis + (1.0 - np.cos(angle)) * axis @ axis
        return RigidMotion(turn @ self.rotation, self.translation + change[:dim], self.centre)

    def change_to(self, other: RigidMotion) -> Floats:
        """Change from this motion to another, (n,). It is exact if the two motions differ by less than half a turn."""
        turn = other.rotation @ self.rotation.T
        skew = 0.5 * (turn - turn.T)
        axes = np.array([0.5 * np.sum(G * skew) for G in GENERATORS[len(self.centre)]])
        sine = float(np.linalg.norm(axes))
        cosine = 0.5 * float(np.trace(turn) - (len(turn) - 2))
        angle = np.arctan2(sine, cosine)
        return np.concatenate([other.translation - self.translation, axes * (angle / sine if sine > 0.0 else 1.0)])
