"""Direct sightings of the target, such as by ultrasound, as measurements of the state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats
from estimators.filters.mixture import InteractingMixture
from estimators.process.process_model import TissueModel
from estimators.process.target import TargetMap
from estimators.tissue.estimate import checked_measurement


@dataclass(frozen=True, slots=True, eq=False)
class FixMeasurement:
    """A fix as z = H x + noise of covariance R: z [m], (dim,); H (dim, dim_x); R [m²], (dim, dim)."""

    z: Floats
    H: Floats
    R: Floats

    def nis(self, mixture: InteractingMixture) -> float:
        """Normalised innovation squared, by the moments of the whole mixture."""
        y = self.z - self.H @ mixture.x
        return float(y @ np.linalg.solve(self.H @ mixture.P @ self.H.T + self.R, y))


def fix_measurement(model: TissueModel, target: TargetMap, position: Floats, cov: Floats) -> FixMeasurement:
    """A fix at a position [m], (dim,), of this covariance [m²]; the error that fixes share, if any, is in the state.

    Raises ValueError for another dimension than the tissue's, and as `checked_measurement` does.
    """
    dim = model.network.dim
    if np.shape(position) != (dim,) or np.shape(cov) != (dim, dim):
        raise ValueError(f"fix: expected shapes {(dim,)} and {(dim, dim)}, found {np.shape(position)}, {np.shape(cov)}")
    place, R = checked_measurement("fix", position, cov)
    H = target.over(model.dim_x)
    H[:, model.bias_rows] = np.eye(dim)[:, : model.bias_rows.stop - model.bias_rows.start]
    return FixMeasurement(place - target.constant, H, R)
