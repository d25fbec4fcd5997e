"""Simulated world of an insertion: the true tissue and its marks.

The tissue is simulated in more detail than the filter's model. Forces act on all masses, also on hidden ones. There is
friction, and the filter does not know the needle's true constants. `dynamics.needle.steered` states the time steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynamics import (
    MassSpringNetwork,
    NeedleMechanics,
    NeedleMotion,
    NeedlePose,
    SampledForces,
    advance_steered,
    steady_state,
)
from estimators import MarkMeasurement
from estimators.process.target import TargetMap, target_map
from experiments.arrays import Floats
from experiments.formats.needle_file import force_reach_m
from experiments.simulation.cases import Case, at_rest
from experiments.simulation.forces import start_and_forces
from experiments.simulation.seen_marks import misplaced
from experiments.simulation.simulate import true_network

KNOT_S = 1.0 / 480.0
"""Longest interval [s] in which external forces are linear: a quarter of the default `Tremor.interval_s`."""


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """The part of a simulated world that all policies share.

    network: the true tissue; assumed: the filter's network, in its rest shape
    aim: function of the tissue's state that gives the target's position
    knots: external forces over time
    needle: the needle with its true constants
    start: the tissue's state at time 0, see `steady_state`
    noise: errors of the marks [m], (n_frames, n_marks, dim)
    missed: whether each mark is missing, (n_frames, n_marks)
    offset_m: vector from the scene's target to the true target [m], (dim,)
    tip_noise: standard normal numbers from which `tip_error` computes the error of the tip, (dim,)
    share: random number between 0 and 1 from which the run's random lesion radius is computed
    """

    case: Case
    network: MassSpringNetwork
    assumed: MassSpringNetwork
    aim: TargetMap
    knots: SampledForces
    needle: NeedleMechanics
    start: Floats
    noise: Floats
    missed: NDArray[np.bool_]
    offset_m: Floats
    tip_noise: Floats
    share: float

    @property
    def entry(self) -> Floats:
        """Entry of the needle [m], (dim,)."""
        return self.case.plan.insertion.entry

    @property
    def pierced(self) -> bool:
        """Whether the skin has no resistance."""
        return self.case.plan.forces.puncture_N == 0.0

    def frame_s(self, k: int) -> float:
        """Exposure time of a frame [s]."""
        return k / self.case.frames_per_s

    def target(self, state: Floats) -> Floats:
        """True position of the target in a state of the tissue [m], (dim,); the registration error is included."""
        return self.aim.position(state) + self.offset_m

    def marks(self, k: int, state: Floats) -> list[MarkMeasurement]:
        """Marks at frame k for a state of the tissue."""
        sd = 1e-3 * self.case.seen.sd_mm
        cov = sd**2 * np.eye(self.network.dim)
        return [
            MarkMeasurement(node, state[self.network.coordinates(node)] + self.noise[k, i], cov)
            for i, node in enumerate(self.case.given.measured_nodes)
            if not self.missed[k, i]
        ]

    def moved(
        self, state: Floats, drive: NeedleMotion, between_s: tuple[float, float], punctured: bool
    ) -> tuple[Floats, bool]:
        """The tissue's state at the end of an interval, and whether the needle has punctured the skin by then."""
        world = self.network, self.needle, state, drive
        return advance_steered(*world, outside=self.knots, between_s=between_s, punctured=punctured)

    def untouched(self, state: Floats, k: int) -> Floats:
        """State of the tissue at the frame after frame k, without a needle."""
        away = NeedleMotion(self.entry, np.zeros(self.network.dim), self.case.plan.insertion.axis, -1.0)
        return self.moved(state, away, (self.frame_s(k), self.frame_s(k + 1)), punctured=False)[0]


def world_of(case: Case) -> World:
    """The world of a case, determined by its seed. Raises InputError for an impossible scenario."""
    network, nodes = at_rest(true_network(case.truth.network, case.scenario, case.seed)), case.given.measured_nodes
    if case.truth.mesh is not None:
        network = case.truth.mesh.in_all_responses(network)
    rng = np.random.default_rng([case.seed, 7])
    lasting = case.n_frames / case.frames_per_s + 1.0
    change: dict[str, object] = {"duration_s": lasting}
    scenario = case.scenario
    for key, table in (("pokes", scenario.pokes), ("breathing", scenario.breathing)):
        if table is not None:
            stronger = case.strength * table.acceleration_m_s2
            change[key] = table.model_copy(update={"acceleration_m_s2": stronger})
    start, forces = start_and_forces(network, scenario.model_copy(update=change), rng)
    knot_s = KNOT_S if scenario.tremor is None else min(KNOT_S, scenario.tremor.interval_s / 4.0)
    times = np.arange(0.0, lasting, knot_s)
    knots = sum((np.array([force(t) for t in times]) for force in forces), np.zeros((len(times), *start.shape)))
    stated = case.plan.forces
    low, high = 1.0 - stated.error, 1.0 + stated.error
    true = {key: value * rng.uniform(low, high) for key, value in stated.constants().items()}
    noise = rng.normal(0.0, 1e-3 * case.seen.sd_mm, (case.n_frames, len(nodes), network.dim))
    missed, wild = misplaced(noise.shape, case.seen, np.random.default_rng([case.seed, 8]))
    registration = np.random.default_rng([case.seed, 10]).normal(size=network.dim)
    target = case.truth.target.point
    return World(
        case,
        network,
        at_rest(case.given.network),
        target_map(network, target),
        SampledForces(knots, knot_s),
        needle_with(network, case.plan.insertion.entry, true),
        steady_state(network, start),
        noise + wild,
        missed,
        target.sd_m * registration,
        rng.normal(size=network.dim),
        float(rng.uniform()),
    )


def needle_with(network: MassSpringNetwork, entry: Floats, constants: dict[str, float]) -> NeedleMechanics:
    """A needle with these constants in a network."""
    still = NeedlePose(entry, np.zeros(network.dim), 0.0, 0.0)
    most = {**constants, "puncture_N": constants["puncture_N"] or np.finfo(float).tiny}
    return NeedleMechanics(lambda _t: still, entry, reach_m=force_reach_m(network), **most)
