"""The update by marks: one linear measurement of a frame, its innovation, and what each mark contributes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynamics import MassSpringNetwork
from estimators.arrays import Floats
from estimators.filters.kernels import block_contributions, inverse_nis_gain, nis_left
from estimators.filters.measurement import Outliers
from estimators.filters.mixture import InteractingMixture
from estimators.process.process_model import TissueModel
from estimators.process.target import TargetMap
from estimators.tissue.estimate import CommonShift, MarkMeasurement
from estimators.tissue.settings import FilterSettings


@dataclass(frozen=True, slots=True, eq=False)
class StackedMarks:
    """The marks of a frame as one measurement z = x[rows] + noise.

    z [m], (m,); rows of the state, m of them; R: covariance of the noise [m²], (m, m)
    shared: what each column moves z by [m], (m, n_columns), where a calibration is considered; else None
    """

    z: Floats
    rows: list[int]
    R: Floats
    shared: Floats | None

    def H(self, dim_x: int) -> Floats:  # noqa: N802
        """The measurement matrix, (m, dim_x)."""
        H = np.zeros((len(self.rows), dim_x))
        H[range(len(self.rows)), self.rows] = 1.0
        return H


@dataclass(frozen=True, slots=True, eq=False)
class Innovation:
    """The innovation of a frame's marks by the moments of the whole mixture, as if it were one Gaussian.

    y [m], (m,); S [m²], (m, m) and its inverse; nis; gain: of the target, (dim, m)
    """

    y: Floats
    S: Floats
    S_inv: Floats
    nis: float
    gain: Floats

    @property
    def shift(self) -> CommonShift:
        """What one shift of all marks explains of it."""
        dim = len(self.gain)
        return CommonShift(len(self.y) // dim, *nis_left(self.y, self.S_inv, dim))


def outliers_of(network: MassSpringNetwork, rest: Floats, settings: FilterSettings) -> Outliers | None:
    """What a mark may be besides the node's: anything within the extent of the tissue at rest, (n_nodes, dim) [m].

    None where no blows are expected: then the gate decides what is an outlier, by all modes at once.
    """
    if not settings.strikes:
        return None
    return Outliers(network.dim, float(np.ptp(rest, axis=0).max()) ** 2, float(np.log(settings.outlier_odds)))


def check_marks(marks: Sequence[MarkMeasurement], coordinates: Mapping[str, slice], model: TissueModel) -> None:
    """Raise ValueError for a mark that is not on a free node, or that has another dimension than the tissue.

    And for marks whose `shared` have different numbers of directions, or not those of a considered calibration.
    """
    dim, n_calibration = model.network.dim, model.n_calibration
    n_shared = n_calibration or next((mark.shared.shape[1] for mark in marks if mark.shared is not None), 0)
    for mark in marks:
        if mark.node not in coordinates:
            raise ValueError(f"mark {mark.node}: expected one on a free node of the network, found none of that name")
        if len(mark.position) != dim:
            raise ValueError(f"mark {mark.node} position: expected shape {(dim,)}, found {mark.position.shape}")
        if mark.shared is not None and mark.shared.shape[1] != n_shared:
            raise ValueError(f"mark {mark.node} shared: expected {n_shared} directions, found {mark.shared.shape[1]}")


def stack_marks(marks: Sequence[MarkMeasurement], coordinates: Mapping[str, slice], model: TissueModel) -> StackedMarks:
    """The marks of a frame as one measurement; coordinates: of each node in the state."""
    z = np.concatenate([mark.position for mark in marks])
    rows = [i for mark in marks for i in range(coordinates[mark.node].start, coordinates[mark.node].stop)]
    R, dim = np.zeros((len(z), len(z))), model.network.dim
    for k, mark in enumerate(marks):
        own = slice(k * dim, (k + 1) * dim)
        R[own, own] = mark.cov
    n_shared = model.n_calibration or next((mark.shared.shape[1] for mark in marks if mark.shared is not None), 0)
    if not n_shared:
        return StackedMarks(z, rows, R, None)
    none = np.zeros((dim, n_shared))
    shared = np.concatenate([none if mark.shared is None else mark.shared for mark in marks])
    if model.n_calibration:
        return StackedMarks(z, rows, R, model.among_columns(shared))
    return StackedMarks(z, rows, R + shared @ shared.T, None)


def innovation(mixture: InteractingMixture, stacked: StackedMarks, target: TargetMap) -> Innovation:
    """The innovation of a measurement that the mixture has not taken in yet."""
    rows, shared, P = stacked.rows, stacked.shared, mixture.P
    y, S, cross = stacked.z - mixture.x[rows], P[rows][:, rows] + stacked.R, target.linear(P[:, rows])
    if shared is not None:
        columns = mixture.mean_columns
        S += columns[rows] @ shared.T + shared @ columns[rows].T + shared @ shared.T
        cross += target.linear(columns) @ shared.T
    S_inv, nis, gain = inverse_nis_gain(y, np.ascontiguousarray(S), np.ascontiguousarray(cross))
    return Innovation(y, S, S_inv, float(nis), gain)


def information_shares(marks: Sequence[MarkMeasurement], found: Innovation, target_variance: float) -> dict[str, float]:
    """By node, by how much the target's variance would be larger had that mark been left out of the update.

    target_variance: trace of the target's covariance after it [m²]. Leaving out block i gives back
    G_i (S^-1_ii)^-1 G_i' of what the update took, G the gain of the target.
    """
    contributions = block_contributions(found.gain, found.S_inv, len(found.gain)) / target_variance
    return {mark.node: share for mark, share in zip(marks, contributions.tolist(), strict=True)}
