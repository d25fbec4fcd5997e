"""Displacement of the target by the needle before the needle arrives; advice aims at the displaced target."""

from __future__ import annotations

import numpy as np

from dynamics import MassSpringNetwork
from estimators.arrays import Floats
from estimators.guidance.needle import Insertion
from estimators.guidance.path import TargetPath
from estimators.guidance.planning import PlannedNeedle, compliance, needle_displacement
from estimators.process.target import TargetPoint, target_map


class NeedlePush:
    """Predicted displacement of the target by the needle's forces, linearised about rest [dimaio2003].

    If the needle is already inside, the marks show its effect so far. Only the further displacement is then predicted.
    For a body without anchors, no displacement is predicted.

    target: a node's name or a point of the tissue; needle: constants of the needle's forces
    """

    def __init__(self, network: MassSpringNetwork, target: str | TargetPoint, needle: PlannedNeedle) -> None:
        self._network, self._needle = network, needle
        self._rest = target_map(network, target).position(network.positions[network.free].ravel())
        self._gives: Floats | None = None
        if network.fixed.any() and (needle.cutting_N or needle.friction_N_m):
            try:
                self._gives = compliance(network, target)
            except np.linalg.LinAlgError:  # some motion meets no resistance
                self._gives = None

    def shift(self, insertion: Insertion) -> Floats:
        """Further displacement of the target [m], (dim,), while the tip advances to the depth of the target at rest."""
        length = float((self._rest - insertion.entry) @ insertion.axis)
        if self._gives is None or length <= insertion.depth_m:
            return np.zeros(self._network.dim)
        depths = np.array([length, insertion.depth_m] if insertion.depth_m > 0.0 else [length])
        entries = np.tile(insertion.entry, (len(depths), 1))
        tips = entries + depths[:, None] * insertion.axis
        moved = needle_displacement(self._network, self._gives, self._needle, tips, entries)
        return np.asarray(moved[0] - moved[1:].sum(axis=0))

    def pushed(self, path: TargetPath, insertion: Insertion) -> TargetPath:
        """The path after the displacement `shift`. The uncertainty of the needle's forces increases the covariances."""
        shift = self.shift(insertion)
        return path.moved(shift, self._needle.force_sd**2 * np.outer(shift, shift))
