"""What a filter takes in and gives out: marks, estimates of the target, Gaussian mixtures."""

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
"""By how much a stated covariance may be asymmetric, by its largest entry: rounding of a product J C J'."""


class Status(StrEnum):
    """How far an estimate may be relied upon."""

    INITIALISING = "INITIALISING"
    """No marks yet, or the first ones: where the tissue is, but not yet how it moves, or in which of many shapes."""
    TRACKING = "TRACKING"
    """Marks were taken in with this frame."""
    COASTING = "COASTING"
    """No mark was taken in: the model alone, for less than the time after which the target counts as lost."""
    LOST = "LOST"
    """No mark for longer than that."""
    DIVERGED = "DIVERGED"
    """The marks contradicted the belief: it was given up, and the new one has not stood the test yet."""


@dataclass(frozen=True, slots=True, eq=False)
class MarkMeasurement:
    """One mark seen.

    node: that it sits on; position [m], (dim,); cov: of its own errors [m²], (dim, dim), positive definite
    shared: what errors that all marks of a frame share, those of the camera's calibration, move it by: by one standard
        deviation of each independent one [m], (dim, n_shared)
    Arrays are copied and cannot be written, so that what was checked stays so.
    """

    node: str
    position: Floats
    cov: Floats
    shared: Floats | None = None

    @property
    def total_cov(self) -> Floats:
        """Of its own errors and of those that it shares [m²], (dim, dim)."""
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
    """Copies of a measured position (dim,) and its covariance (dim, dim); ValueError where they cannot be that.

    what: the name of the measurement in messages
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
    """What one shift of all marks of a frame explains of their innovations, of those that the gate rejected, too.

    n_marks: how many there are; nis: normalised innovation squared that is left by the best such shift
    nis_of_one: what is left by the best shift of any one of them, which is to leave it out
    """

    n_marks: int
    nis: float
    nis_of_one: float


@dataclass(frozen=True, slots=True, eq=False)
class TargetEstimate:
    """Gaussian belief about the target at one exposure time.

    time_s: exposure time of the frame [s]
    mean, cov: position of the target [m], (dim,), and its covariance [m²], (dim, dim); cov is None where a method
        gives none
    status: see `Status`
    marks_used: marks taken in with this frame
    nis: normalised innovation squared of those marks, None where there were none or the method gives none
    poked: probability that an outside force acts, None where the method gives none
    model_only: whether the marks contribute next to nothing and the model alone speaks
    gain: part of the open loop's variance of the target that the filter takes away, at most 1; below 0 where the
        filter, which allows for pokes and wrong constants, is the more uncertain of the two
    information_share: by node, how much larger the target's variance would be had that mark been left out of this frame
    shift: what one shift of all marks of this frame explains, None without marks and of those that a start is made by
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


@dataclass(frozen=True, slots=True, eq=False)
class GaussianMixture:
    """A Gaussian mixture: weights (k,) that sum to one, means [m] (k, dim), covs [m²] (k, dim, dim)."""

    weights: Floats
    means: Floats
    covs: Floats

    def __post_init__(self) -> None:
        k, dim = self.means.shape
        if self.weights.shape != (k,) or self.covs.shape != (k, dim, dim):
            raise ValueError(
                f"belief: expected shapes {(k,)}, {(k, dim)} and {(k, dim, dim)}, "
                f"found {self.weights.shape}, {self.means.shape} and {self.covs.shape}"
            )
        if not (np.all(self.weights >= 0.0) and abs(self.weights.sum() - 1.0) < 1e-9):
            raise ValueError(f"belief weights: expected 0 or more that sum to 1, found {self.weights}")

    @classmethod
    def gaussian(cls, mean: Floats, cov: Floats) -> GaussianMixture:
        """A single Gaussian: mean [m], (dim,), cov [m²], (dim, dim)."""
        return cls(np.ones(1), np.asarray(mean, dtype=float)[None], np.asarray(cov, dtype=float)[None])
