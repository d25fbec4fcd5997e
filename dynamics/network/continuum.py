"""Linear elastic solid between the nodes of a network: a mesh, reduced to a few modes about the drawn shape."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from dynamics.arrays import Floats, made_again

LOOSE = 1e-6
"""A mode meets no stiffness if its squared angular frequency is below this share of the largest squared one [1]."""

FREE = 0.2
"""Assumed growth rate of forces [1/s]; numerical: under constant forces, a free body would move without limit."""


@dataclass(frozen=True, slots=True, eq=False)
class Continuum:
    """Vibration modes of a solid that rests as drawn, and its matrices condensed to the free nodes of the network.

    A modal coordinate is the root mean square displacement of the body, weighted by mass. The mass of each mode is
    therefore the mass of the whole body. If a driven wall holds the body, the first six modes are the rigid motions of
    this wall.

    Attributes
    ----------
    tissues : tuple of str
        Names of the n_tissues tissues.
    mass : float
        Mass of the whole body [kg].
    extent_m : float
        Diagonal of the box around the body [m].
    masses : (n_modes,)
        Mass of each mode [kg]; infinite for the motions of a driven wall, because no force changes them.
    shapes : (n_free dim, n_modes)
        Displacement of the network's free nodes per modal coordinate [1].
    rates : (n_modes,)
        Squares of the angular frequencies [1/s²].
    damping : (n_modes,)
        Damping divided by mass [1/s].
    by_tissue : (n_tissues, n_modes, n_modes)
        Stiffness of each tissue divided by mass [1/s²]; their sum is the diagonal matrix of `rates`.
    forces : (n_modes, any)
        Acceleration of each mode by each force field, divided by the field's force per mass of the body [1]. The first
        three fields are uniform forces along the axes, and the others are smooth surface forces.
    omitted : (n_free dim, any)
        Static displacement of the free nodes by each force field beyond the modes [s²], in the unit of `forces`.
    stiffness, dashpots : (n_free dim, n_free dim)
        Matrices condensed to the free nodes [N/m], [N s/m].
    """

    tissues: tuple[str, ...]
    mass: float
    extent_m: float
    masses: Floats
    shapes: Floats
    rates: Floats
    damping: Floats
    by_tissue: Floats
    forces: Floats
    omitted: Floats
    stiffness: Floats
    dashpots: Floats

    def __post_init__(self) -> None:
        n, n_modes = self.shapes.shape
        shapes = {
            "masses": (n_modes,),
            "rates": (n_modes,),
            "damping": (n_modes,),
            "by_tissue": (len(self.tissues), n_modes, n_modes),
            "forces": (n_modes, self.forces.shape[-1]),
            "omitted": (n, self.forces.shape[-1]),
            "stiffness": (n, n),
            "dashpots": (n, n),
        }
        for key, shape in shapes.items():
            if getattr(self, key).shape != shape:
                raise ValueError(f"continuum {key}: expected shape {shape}, found {getattr(self, key).shape}")
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                own = np.array(value, dtype=float)
                own.setflags(write=False)
                object.__setattr__(self, field.name, own)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return made_again(self)

    @property
    def accelerated(self) -> Floats:
        """Static displacement of the free nodes per gravity acceleration along each axis [s²], (n_free dim, dim)."""
        held = self.rates > LOOSE * self.rates.max()
        return np.asarray(self.shapes[:, held] @ (self.forces[held, :3] / self.rates[held, None]) + self.omitted[:, :3])

    @property
    def residual(self) -> Floats:
        """Compliance of the free nodes that the modes do not describe [m/N], (n_free dim, n_free dim) [macneal1971]."""
        by_modes = (self.shapes / (self.masses * (self.rates + FREE**2))) @ self.shapes.T
        return np.asarray(np.linalg.inv(self.stiffness) - by_modes)

    def scaled(self, factors: Floats) -> Continuum:
        """The continuum with new modes and with the stiffness of each tissue times its factor, (n_tissues,)."""
        own = factors[:, None, None] * self.by_tissue
        rates, turn = np.linalg.eigh(own.sum(axis=0))
        # Change of the points' compliance in the modes
        before = np.linalg.inv(self.stiffness)
        by_rate = [
            np.where(w > LOOSE * w.max(), 1.0 / np.maximum(w, LOOSE * w.max()), 0.0) for w in (rates, self.rates)
        ]
        shapes = self.shapes @ turn
        after = before + ((shapes * by_rate[0]) @ shapes.T - (self.shapes * by_rate[1]) @ self.shapes.T) / self.mass
        after = 0.5 * (after + after.T)
        stiffness = np.linalg.inv(after)
        return replace(
            self,
            shapes=shapes,
            rates=np.maximum(rates, 0.0),
            damping=np.einsum("ir,ij,jr->r", turn, np.diag(self.damping), turn),
            by_tissue=turn.T @ own @ turn,
            forces=turn.T @ self.forces,
            omitted=self.omitted * (self.rates.sum() / rates.sum()),
            stiffness=0.5 * (stiffness + stiffness.T),
        )

    def with_driven_wall(self, places: Floats) -> Continuum:
        """The continuum on a wall that moves as a rigid body in an unknown way.

        Six added modes move all free nodes rigidly with the wall. places: positions of the free nodes [m], (n_free, 3)
        """
        arms = (places - places.mean(axis=0)) / self.extent_m
        turns = np.cross(np.eye(3)[:, None], arms).reshape(3, -1).T
        return replace(
            self,
            masses=np.r_[np.full(6, np.inf), self.masses],
            shapes=np.hstack([np.tile(np.eye(3), (len(places), 1)), turns, self.shapes]),
            rates=np.r_[np.zeros(6), self.rates],
            damping=np.r_[np.zeros(6), self.damping],
            by_tissue=np.pad(self.by_tissue, ((0, 0), (6, 0), (6, 0))),
            forces=np.pad(self.forces, ((6, 0), (0, 0))),
        )

    def by_log_stiffness(self, shift: Floats) -> Floats:
        """Derivative of nodal forces with respect to the log of each tissue's stiffness [N], (n_tissues, n_free dim).

        shift: displacement of the free nodes from the drawn shape [m], (n_free dim,)
        """
        rates = np.maximum(self.rates, LOOSE * self.rates.max())
        modal = self.shapes.T @ (self.stiffness @ shift) / (rates * self.mass)
        moved = (self.by_tissue @ modal) / rates
        return np.asarray(-(moved @ self.shapes.T) @ self.stiffness)
