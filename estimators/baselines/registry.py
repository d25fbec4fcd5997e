"""Methods that `softaim compare` compares with the filter and the open loop, by name.

A new method needs a file with its `Baseline`, and one line in METHODS.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.baselines.ensemble import EnsembleKalmanFilter
from estimators.baselines.extended import ExtendedKalmanFilter
from estimators.baselines.particles import ParticleFilter
from estimators.baselines.smoother import FixedIntervalSmoother
from estimators.baselines.stock import StockUnscented
from estimators.process.target import TargetPoint
from estimators.smoothing.smoother import TimedFix
from estimators.tissue.estimate import MarkMeasurement, TargetEstimate
from estimators.tissue.settings import FilterSettings


class UnknownMethodError(LookupError):
    """Error for a name that is not in METHODS. The message lists the names in METHODS."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackingProblem:
    """Inputs of every method for comparison.

    target: name of a node, or a point relative to nodes; marked: nodes whose marks are measured
    uncertainty: uncertainty of the constants; n_calibration: number of columns of `MarkMeasurement.shared`
    seed: seed for methods that draw random numbers; fixes: direct measurements of the target, which the smoother uses
    """

    network: MassSpringNetwork
    target: str | TargetPoint
    marked: Sequence[str]
    settings: FilterSettings
    uncertainty: ParameterUncertainty | None = None
    n_calibration: int = 0
    seed: int = 0
    fixes: Sequence[TimedFix] = ()

    @property
    def physics(self) -> tuple[MassSpringNetwork, str | TargetPoint, Sequence[str], FilterSettings]:
        """Arguments of every baseline: network, target, marked nodes, settings."""
        return self.network, self.target, self.marked, self.settings

    @property
    def rng(self) -> np.random.Generator:
        """New random generator with the given seed, so that results are reproducible."""
        return np.random.default_rng(self.seed)


class Method(Protocol):
    """Protocol of a method for comparison."""

    def run(
        self,
        frames: Sequence[tuple[float, Sequence[MarkMeasurement]]],
        advance: Callable[[float], None] = lambda _share: None,
    ) -> Iterator[list[TargetEstimate]]:
        """Yield the estimates. A filter yields a list for each frame, a smoother yields one list after the last frame.

        frames: (time [s], marks) in order; advance: called with the completed share of the frames
        """


METHODS: dict[str, Callable[[TrackingProblem], Method]] = {
    "ekf": lambda problem: ExtendedKalmanFilter(*problem.physics),
    "filterpy-ukf": lambda problem: StockUnscented(*problem.physics),
    "enkf": lambda problem: EnsembleKalmanFilter(*problem.physics, rng=problem.rng, n_members=None),
    "particles": lambda problem: ParticleFilter(*problem.physics, rng=problem.rng),
    "smoother": lambda problem: FixedIntervalSmoother(
        *problem.physics, uncertainty=problem.uncertainty, n_calibration=problem.n_calibration, fixes=problem.fixes
    ),
}
"""Functions that make the methods, by name, in the order of tables and plots."""


def make_method(name: str, problem: TrackingProblem) -> Method:
    """Make the method with this name. Raises UnknownMethodError."""
    if name not in METHODS:
        raise UnknownMethodError(f'method: expected one of {", ".join(METHODS)}, found "{name}"')
    return METHODS[name](problem)
