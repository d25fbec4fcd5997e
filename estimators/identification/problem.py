"""Estimation problem of a recording: unknown constants, and passes of the filter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.arrays import Floats
from estimators.identification.budget import Budget, OutOfTimeError
from estimators.identification.filter_pass import Frames, Pass, pass_through
from estimators.identification.groups import ConstantGroup, group_directions, scale_groups, touched
from estimators.identification.search import Optimum, followed
from estimators.identification.stretch import affordable, frame_seconds
from estimators.tissue.settings import FilterSettings

SCREENED = 100
"""Largest number of consecutive frames for the searches from all starts; choice: fewer frames do not contain half an
oscillation of the phantom. The best result is then improved with all frames."""

PASSES_A_SEARCH = 6
"""Expected number of filter passes of a search. The reported progress and the used frames depend on this number."""

STRENGTH_PASSES = 8
"""Largest number of filter passes for the strength of the unknown forces on a continuum; choice: four to eight are
usual."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Estimation problem of a recording. Unknown theta, (n,): log of each group's factor, divided by its entry of sd.

    sd: prior standard deviation of each log, (n,); nodes: the marked nodes, and the target
    """

    network: MassSpringNetwork
    groups: tuple[ConstantGroup, ...]
    sd: Floats
    nodes: tuple[tuple[str, ...], str]
    settings: FilterSettings
    budget: Budget

    @property
    def n_passes(self) -> int:
        """Number of filter passes through all used frames for which time is reserved."""
        return PASSES_A_SEARCH + (0 if self.network.continuum is None else STRENGTH_PASSES)

    def model(self, theta: Floats) -> MassSpringNetwork:
        """The network with the constants that theta describes, (n,)."""
        return scale_groups(self.network, self.groups, self.sd * theta)

    def directions(self, model: MassSpringNetwork, rows: Floats) -> ParameterUncertainty:
        """Uncertainty of the constants; rows: change of each group's log factor by each of k errors, (k, n_groups)."""
        which = touched(self.groups)
        return ParameterUncertainty(which, rows @ group_directions(model, self.groups, which))

    def at(self, theta: Floats, frames: Frames) -> Pass:
        """Run the filter through frames with the constants that theta describes. Raises OutOfTimeError."""
        model = self.model(theta)
        prior = self.directions(model, np.diag(self.sd))
        return pass_through(model, prior, frames, self.nodes, self.settings, self.budget)

    def followed(self, frames: Frames, start: Floats) -> Optimum | None:
        """Result of the search from a start; None if the time is too short for a pass."""
        return followed(lambda theta: self.at(theta, frames), start, self.sd)

    def planned(self, frames: Frames, n_starts: int) -> tuple[int, Frames]:
        """Number of starts that fit into the time, and frames to use. Raises OutOfTimeError if no start fits."""
        given = np.zeros(len(self.groups))
        frame_s = frame_seconds(lambda some: self.at(given, some), frames, self.budget)
        n_passes = self.n_passes + 1
        try:
            starts_s = PASSES_A_SEARCH * n_starts * min(SCREENED, len(frames)) * frame_s
            used = affordable(frames, frame_s, n_passes, self.budget, reserved_s=starts_s)
        except OutOfTimeError:
            used = frames[:0]
        if len(used) >= min(SCREENED, len(frames)):
            return n_starts, used
        return 1, affordable(frames, frame_s, n_passes + PASSES_A_SEARCH, self.budget)
