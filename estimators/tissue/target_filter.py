"""What guidance, association, smoothing and the commands know of a filter of the tissue."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np

from dynamics import SAME_STEP, MassSpringNetwork
from estimators.arrays import Floats
from estimators.process.known_force import ForceHistory
from estimators.process.target import TargetMap
from estimators.tissue.estimate import GaussianMixture, MarkMeasurement, TargetEstimate
from estimators.tissue.health import Health
from estimators.tissue.settings import FilterSettings

Restored: TypeAlias = Any
"""The whole state of a filter at one time, to which it can be set back; only the filter knows what is in it."""


def times_until(seconds: float, cycle_s: float) -> int:
    """How many times, cycle_s [s] apart from now on, reach so far ahead [s]."""
    return int(np.ceil(seconds / cycle_s * (1.0 - SAME_STEP))) + 1


class PathTables(Protocol):
    """The target ahead at n_times times, cycle_s [s] apart, by a linear motion about rest.

    shape: of all nodes at rest [m], (n_nodes, dim)
    """

    @property
    def cycle_s(self) -> float:
        """Between two times [s]."""

    @property
    def n_times(self) -> int:
        """How many times there are."""

    @property
    def shape(self) -> Floats:
        """At rest [m], (n_nodes, dim)."""

    def ahead(self, tissue: Any, push: Floats | None = None) -> tuple[Floats, Floats, Floats]:
        """Times [s] (k,), means [m] (k, dim) and covariances [m²] (k, dim, dim) of the target from now on.

        push: a known force on the free nodes [N], held in each cycle ahead, (k - 1, n_free, dim)
        """

    def shift(self, push: Floats) -> Floats:
        """By how much a known force moves the target [m], (k, dim); push as for `ahead`."""

    def parts(self, tissue: Any) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
        """As `ahead`, and the probability (k,) that nobody pokes until each time, with mean and covariance if so."""


class Tabled(Protocol):
    """A filter that makes its own tables."""

    def tables(self, n_times: int, cycle_s: float) -> PathTables:
        """The target ahead at so many times, so far apart [s]."""


@runtime_checkable
class TargetFilter(Protocol):
    """Where the target is and will be, from marks: `TissueFilter` or `UnifiedFilter`.

    health, rejected, repairs, log_likelihood: as `TissueFilter` has them; network: that it moves
    """

    health: Health
    time_s: float | None
    rejected: Counter[str]
    log_likelihood: float
    n_calibration: int
    settings: FilterSettings
    target: TargetMap

    @property
    def network(self) -> MassSpringNetwork:
        """The network that it moves."""

    @property
    def repairs(self) -> Counter[str]:
        """Counts of repairs, by kind."""

    @property
    def seen_s(self) -> float | None:
        """When a mark was last taken in [s], None before the first."""

    @property
    def positions(self) -> Floats:
        """Mean places of all nodes now [m], (n_nodes, dim)."""

    @property
    def is_finite(self) -> bool:
        """Whether the state is one of numbers: no mark would mend another."""

    @property
    def may_be_led(self) -> bool:
        """Whether the body may be led for as long as it likes: then all marks may move together."""

    @property
    def by_calibration(self) -> Floats:
        """How each error of the calibration, one standard deviation, moves the target [m], (dim, n_calibration)."""

    def predict(self, time_s: float, push: ForceHistory | None = None) -> None:
        """Move the state to this exposure time [s]."""

    def predict_at(self, time_s: float, push: ForceHistory | None = None) -> TargetEstimate:
        """The target at a later time [s]; the state stays."""

    def predict_modes(self, time_s: float, push: ForceHistory | None = None) -> GaussianMixture:
        """As `predict_at`, as a mixture."""

    def predict_path(self, times_s: Floats) -> tuple[Floats, Floats]:
        """The target at later times [s], (k,): means [m] (k, dim), covs [m²] (k, dim, dim)."""

    def update(self, marks: Sequence[MarkMeasurement]) -> TargetEstimate:
        """Take in the marks that were seen at the state's time, and estimate the target."""

    def fix(self, position: Floats, cov: Floats) -> TargetEstimate:
        """Take in a direct sighting of the target: position [m], (dim,), its covariance [m²]."""

    def place_of(self, point: TargetMap) -> tuple[Floats, Floats]:
        """Mean [m], (dim,), and covariance [m²], (dim, dim), of a point of the tissue."""

    def expected(self, node: str, shared: Floats | None = None) -> tuple[Floats, Floats]:
        """Where to search for a free node's mark [m], (dim,), and the covariance of that [m²], (dim, dim)."""

    def expected_after_impulse(self, node: str, shared: Floats | None = None) -> tuple[Floats, Floats]:
        """As `expected`, [m] (dim,), [m²] (dim, dim), had an impulse on the node followed just after its last mark.

        shared [m]: (dim, n_calibration)
        """

    def expected_at_rest(self, node: str) -> tuple[Floats, Floats]:
        """As `expected`, [m] (dim,) and [m²] (dim, dim), at rest, without marks."""

    def expected_of(self, nodes: Sequence[str]) -> tuple[Floats, Floats]:
        """Places of free nodes [m], (n, dim), and their covariances [m²], (n, dim, dim), where forces act."""

    def snapshot(self) -> Restored:
        """The whole state now, for `restore`."""

    def restore(self, then: Restored) -> None:
        """Set the state back to a snapshot."""
