"""Inputs and outputs of a filter: marks, estimates of the target, Gaussian mixtures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dynamics.arrays import made_again
from estimators.arrays import Floats
from estimators.filters.kernels import is_gaussian

ROUNDING = 1e-9
"""Largest asymmetry of a covariance that counts as a rounding error, relative to its largest entry [1]; numerical."""


class Status(StrEnum):
    """Status of the filter: whether its estimate can be relied upon."""

    INITIALISING = "INITIALISING"
    """No marks have been used yet, or only the first marks: velocity and shape of the tissue are not known yet."""
    TRACKING = "TRACKING"
    """The marks of this frame were used."""
    COASTING = "COASTING"
    """No mark was used: the estimate is only a prediction, but not yet LOST."""
    LOST = "LOST"
    """No mark was used for longer than the settings' `lost_s`."""
    DIVERGED = "DIVERGED"
    """The marks contradicted the estimate: the filter restarted, and the new estimate is not yet confirmed."""


@dataclass(frozen=True, slots=True, eq=False)
class MarkMeasurement:
    """Measured position of one mark, with its covariance.

    node: name of the node that the mark is on; position: measured position [m], (dim,)
    cov: covariance of the mark's own error [m²], (dim, dim), positive definite
    shared: shift of the mark [m], (dim, n_shared), per standard deviation of each independent error that all marks of a
        frame share, such as a calibration error

    Arrays are checked, copied and made read-only.
    """

    node: str
    position: Floats
    cov: Floats
    shared: Floats | None = None

    @property
    def total_cov(self) -> Floats:
        """Covariance of the mark's own and shared errors [m²], (dim, dim)."""
        return self.cov if self.shared is None else self.cov + self.shared @ self.shared.T

    def __post_init__(self) -> None:
        position, cov = checked_measurement(f"mark {self.node}", self.position, self.cov)
        self._own("position", position)
        self._own("cov", cov)
        if self.shared is None:
            return
        shared = np.array(self.shared, dtype=float)
        if shared.ndim != 2 or len(shared) != len(position):
            raise ValueError(f"mark {self.node} shared: expected {len(position)} rows, found {shared.shape}")
        if not np.isfinite(shared).all():
            raise ValueError(f"mark {self.node} shared: expected finite numbers, found {shared}")
        self._own("shared", shared)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return made_again(self)

    def _own(self, name: str, array: Floats) -> None:
        array.setflags(write=False)
        object.__setattr__(self, name, array)


def checked_measurement(what: str, position: ArrayLike, cov: ArrayLike) -> tuple[Floats, Floats]:
    """Copies of a measured position (dim,) and its covariance (dim, dim); raises ValueError if they are invalid.

    what: name of the measurement for messages
    """
    place, spread = np.array(position, dtype=float), np.array(cov, dtype=float, order="C")
    if place.ndim != 1:
        raise ValueError(f"{what} position: expected one dimension, found shape {place.shape}")
    dim = len(place)
    if spread.shape != (dim, dim):
        raise ValueError(f"{what} cov: expected shape {(dim, dim)}, found {spread.shape}")
    if is_gaussian(place, spread, ROUNDING):
        return place, spread
    if not (np.isfinite(place).all() and np.isfinite(spread).all()):
        raise ValueError(f"{what}: expected finite numbers, found {place} and {spread}")
    raise ValueError(f"{what} cov: expected a symmetric positive definite matrix, found {spread.tolist()}")


@dataclass(frozen=True, slots=True)
class CommonShift:
    """Test of whether one common shift explains the innovations of all marks in a frame, including rejected marks.

    n_marks: number of marks; nis: normalised innovation squared that remains after the best common shift
    nis_of_one: smallest NIS that remains if one mark is omitted. The best shift of only this mark leaves the same NIS
    """

    n_marks: int
    nis: float
    nis_of_one: float


@dataclass(frozen=True, slots=True, eq=False)
class TargetEstimate:
    """Gaussian estimate of the target at one exposure time.

    time_s: exposure time of the frame [s]
    mean, cov: position of the target [m], (dim,), and its covariance [m²], (dim, dim); cov is None for a method without
        covariance
    status: see `Status`
    marks_used: number of marks used in this frame
    nis: normalised innovation squared of the used marks; None without marks, or if the method does not compute it
    poked: probability that a short external force acts; 0 for a continuum, None if the method does not compute it
    model_only: whether marks contribute almost nothing, so that the estimate is a prediction by the model
    gain: `1 - a / b`; a is the variance of the filter, and b the variance of an open-loop estimate, in which the marks
        drive the model and no filter corrects it
    information_share: for each used mark's node, relative increase of the target's variance if the mark were not used
    shift: test for a common shift of all marks; None without marks, and in the first frame with marks
    noise: estimated factor on the standard deviation of the marks' noise [1]; 1 if it is not estimated
    measured: number of coordinates that the used marks measure; None: all coordinates
    """

    time_s: float
    mean: Floats
    cov: Floats | None
    status: Status
    marks_used: int
    nis: float | None = None
    poked: float | None = None
    model_only: bool = False
    gain: float | None = None
    information_share: Mapping[str, float] = field(default_factory=dict)
    shift: CommonShift | None = None
    noise: float = 1.0
    measured: int | None = None

    @property
    def degrees(self) -> int:
        """Degrees of freedom of `nis`."""
        return self.marks_used * len(self.mean) if self.measured is None else self.measured


@dataclass(frozen=True, slots=True, eq=False)
class GaussianMixture:
    """Mixture of k Gaussians: `weights` (k,) with sum 1, `means` (k, dim) in [m], `covs` (k, dim, dim) in [m²]."""

    weights: Floats
    means: Floats
    covs: Floats

    def __post_init__(self) -> None:
        k, dim = self.means.shape
        if self.weights.shape != (k,) or self.covs.shape != (k, dim, dim):
            raise ValueError(
                f"mixture: expected shapes {(k,)}, {(k, dim)} and {(k, dim, dim)}, "
                f"found {self.weights.shape}, {self.means.shape} and {self.covs.shape}"
            )
        if not (np.all(self.weights >= 0.0) and abs(self.weights.sum() - 1.0) < 1e-9):
            raise ValueError(f"mixture weights: expected 0 or more that sum to 1, found {self.weights}")

    @classmethod
    def gaussian(cls, mean: Floats, cov: Floats) -> GaussianMixture:
        """A mixture of one Gaussian with this mean [m], (dim,), and covariance [m²], (dim, dim)."""
        return cls(np.ones(1), np.asarray(mean, dtype=float)[None], np.asarray(cov, dtype=float)[None])
