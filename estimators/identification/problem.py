"""The constants sought in a recording, and the filters that go through it with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.arrays import Floats
from estimators.filters.unscented import CovarianceError
from estimators.identification.budget import Budget, OutOfTimeError
from estimators.identification.filter_pass import Frames, Pass, is_linear, pass_through
from estimators.identification.forced.forced_filter import Forces
from estimators.identification.forced.forces import find_forces, forced_pass
from estimators.identification.forced.recorded import Recorded
from estimators.identification.groups import (
    ConstantGroup,
    group_directions,
    scale_groups,
    touched,
    with_straight_tensions,
)
from estimators.identification.search import Optimum, followed
from estimators.identification.stretch import affordable, frame_seconds
from estimators.identification.withheld import Withheld, withheld_pass, withheld_target
from estimators.tissue.settings import FilterSettings

SLOWING = "damping", "drag", "friction"
"""Kinds of constants by which a velocity makes a force."""

SCREENED = 100
"""Frames, the liveliest ones in a row, through which all starts are followed; the best goes through all frames. More
cost time, with fewer half a swing of the phantom is left; choice, its cost in docs/settings.md."""

PASSES_A_START = 6
"""Of the filter, as expected for the progress and for how many frames the time allows for."""

PASSES_UNDER_FORCES = 60
"""That finding the forces and the constants under them takes the time of, as expected for how many frames the time
allows for; numerical: a third is for forces, a third for likelihoods."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """What is sought in a recording: factors of groups of constants, as theta (n,), logs in prior standard deviations.

    sd: prior standard deviation of each log, (n,); nodes: those that may be poked, and the target
    elastic: whether constants are sought by what marked nodes tell of the others, see `withheld_pass`
    """

    network: MassSpringNetwork
    groups: tuple[ConstantGroup, ...]
    sd: Floats
    nodes: tuple[tuple[str, ...], str]
    settings: FilterSettings
    budget: Budget
    elastic: bool = False

    def model(self, theta: Floats) -> MassSpringNetwork:
        """The network at a point."""
        return scale_groups(self.network, self.groups, self.sd * theta)

    def moved(self, theta: Floats, move: Floats) -> Floats:
        """A point moved by so much, on a curve along which tensions change in proportion."""
        return with_straight_tensions(self.network, self.groups, self.sd * theta, self.sd * move) / self.sd

    @property
    def linear(self) -> bool:
        """Whether the network is too large or too stiff for sigma points."""
        return is_linear(self.network, len(self.nodes[0]))

    @property
    def n_passes(self) -> int:
        """Through all frames, after the starts, as expected."""
        return PASSES_A_START + 1 if self.linear else PASSES_UNDER_FORCES

    @property
    def alike(self) -> Floats:
        """Which constants that act on velocities are of one kind, a row for each kind, (n_kinds, n), 0 or 1."""
        kinds = [group.kind for group in self.groups]
        slowing = [one for one in SLOWING if one in kinds]
        return np.array([[float(kind == one) for kind in kinds] for one in slowing]).reshape(-1, len(kinds))

    def directions(self, model: MassSpringNetwork, rows: Floats) -> ParameterUncertainty:
        """Rows in the logs of the groups' factors, (k, n_groups), as directions of the constants."""
        which = touched(self.groups)
        return ParameterUncertainty(which, rows @ group_directions(model, self.groups, which))

    def prior(self, model: MassSpringNetwork) -> ParameterUncertainty:
        """Of all constants, about a network."""
        return self.directions(model, np.diag(self.sd))

    def recorded(self, frames: Frames) -> Recorded:
        """Frames as what is behind `under_forces` takes them."""
        return Recorded(frames, self.nodes, self.settings, self.budget)

    def at(self, theta: Floats, frames: Frames) -> Pass:
        """The filter that does not know the forces through frames. Raises OutOfTimeError."""
        model = self.model(theta)
        passed = withheld_pass if self.elastic else pass_through
        return passed(model, self.prior(model), frames, self.nodes, self.settings, self.budget)

    def under(self, theta: Floats, frames: Frames, forces: Forces) -> Pass:
        """The filter that knows them. Raises OutOfTimeError."""
        model = self.model(theta)
        return forced_pass(model, self.prior(model), self.recorded(frames), forces)

    def followed(self, frames: Frames, forces: Forces | None, start: Floats) -> Optimum | None:
        """What a start leads to, with or without known forces; None where there is no time for a pass."""

        def passed(theta: Floats) -> Pass:
            return self.at(theta, frames) if forces is None else self.under(theta, frames, forces)

        return followed(passed, start, self.sd)

    def first_forces(self, frames: Frames) -> Forces | None:
        """By the constants given, whose errors pass for pokes; None where there is no finite state."""
        try:
            return find_forces(self.network, self.recorded(frames), None)
        except (CovarianceError, np.linalg.LinAlgError):
            return None

    def withheld(self, frames: Frames, case: tuple[MassSpringNetwork, ParameterUncertainty]) -> Withheld | None:
        """Of a network and its uncertainty; None where there is no time or no finite state."""
        network, uncertainty = case
        try:
            return withheld_target(network, uncertainty, frames, self.nodes, self.settings, self.budget)
        except (OutOfTimeError, CovarianceError, np.linalg.LinAlgError):
            return None

    def planned(self, frames: Frames, n_starts: int) -> tuple[int, Frames]:
        """How many starts and which frames the time allows for: one start where with all of them few frames are left.

        Raises OutOfTimeError where there is none for that, either.
        """
        none, quiet = np.zeros(len(self.groups)), Forces(self.settings.quiet.white)

        def passed(some: Frames) -> Pass:
            return self.at(none, some) if self.linear else self.under(none, some, quiet)

        frame_s = frame_seconds(passed, frames, self.budget)
        try:
            starts_s = PASSES_A_START * n_starts * min(SCREENED, len(frames)) * frame_s
            used = affordable(frames, frame_s, self.n_passes, self.budget, reserved_s=starts_s)
        except OutOfTimeError:
            used = frames[:0]
        if len(used) >= min(SCREENED, len(frames)):
            return n_starts, used
        return 1, affordable(frames, frame_s, self.n_passes + PASSES_A_START, self.budget)
