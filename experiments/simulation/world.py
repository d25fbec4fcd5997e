"""The world that a needle is driven into: the tissue's truth, richer than the filter's model, and its marks.

Forces on all masses, the hidden one included, friction, and a needle whose constants the filter does not know, by steps
sixteen times finer than the filter's (`dynamics.needle.steered`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynamics import (
    HIDDEN,
    OUTER,
    MassSpringNetwork,
    NeedleMechanics,
    NeedleMotion,
    NeedlePose,
    SampledForces,
    advance_steered,
    four_mass_phantom,
    pack,
)
from estimators import MarkMeasurement
from experiments.arrays import Floats
from experiments.formats.scenario import Scenario
from experiments.simulation.simulate import start_and_forces

KNOT_S = 1.0 / 480.0
"""Outside forces are straight over this time [s]: four knots for each of the tremor's."""

STATED = {"puncture_N": 0.8, "contact_N_m": 400.0, "cutting_N": 0.4, "friction_N_m": 5.0}
"""The filter's model of the needle, as in soft PVC (`docs/needle.md`): the target gives way by 2 to 3 mm."""

FORCE_ERROR = 0.3
"""Each true constant of the needle lies between so much less and so much more than what is stated; of the study."""

ENTRY_M = (0.015, 0.020)
"""Where the needle enters, from where the target rests [m]: 25 mm of tissue; a parameter of the simulated study."""


@dataclass(frozen=True, slots=True)
class Case:
    """One insertion to be tried: the scenario, a seed, the needle's speed [m/s], the camera.

    steer_m_s: how fast the robot may move the needle's line sideways [m/s]
    warm_s, patience_s: marks are seen for so long before the needle may start, and it must be there so long after [s]
    strength: of the scenario's pokes and breathing, by what they are
    """

    scenario: Scenario
    seed: int
    speed_m_s: float = 0.05
    steer_m_s: float = 0.05
    frames_per_s: int = 30
    mark_sd_m: float = 0.00414
    warm_s: float = 3.0
    patience_s: float = 10.0
    strength: float = 1.0

    @property
    def n_frames(self) -> int:
        """That the camera takes until patience ends."""
        return int(np.ceil((self.warm_s + self.patience_s) * self.frames_per_s)) + 1


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """What is the same for every policy.

    knots: outside forces; needle: its true constants; start: the tissue's state at time 0, (n_state,)
    noise: of the marks on OUTER [m], (n_frames, n_marks, dim); entry: of the needle [m], (dim,)
    tip_noise: standard normal, (dim,): error of the tip at last, in standard deviations
    share: in (0, 1), for what is drawn once a run
    """

    case: Case
    network: MassSpringNetwork
    knots: SampledForces
    needle: NeedleMechanics
    start: Floats
    noise: Floats
    entry: Floats
    tip_noise: Floats
    share: float

    def frame_s(self, k: int) -> float:
        """Exposure time of a frame [s]."""
        return k / self.case.frames_per_s

    def target(self, state: Floats) -> Floats:
        """Where the target is in a state [m], (dim,)."""
        return state[self.network.coordinates(HIDDEN)]

    def marks(self, k: int, state: Floats) -> list[MarkMeasurement]:
        """What the camera sees of a state at a frame."""
        sd = self.case.mark_sd_m
        cov = sd**2 * np.eye(self.network.dim)
        return [
            MarkMeasurement(node, state[self.network.coordinates(node)] + self.noise[k, i], cov)
            for i, node in enumerate(OUTER)
        ]

    def moved(
        self, state: Floats, drive: NeedleMotion, between_s: tuple[float, float], punctured: bool
    ) -> tuple[Floats, bool]:
        """The tissue under the needle from one time to another [s], and whether the skin has given way."""
        return advance_steered(
            self.network,
            self.needle,
            state,
            drive,
            outside=self.knots,
            between_s=between_s,
            punctured=punctured,
        )


def world_of(case: Case) -> World:
    """The world of a case, by its seed alone. Raises InputError for a scenario that cannot be."""
    network = four_mass_phantom()
    rng = np.random.default_rng([case.seed, 7])
    lasting = case.n_frames / case.frames_per_s + 1.0
    change: dict[str, object] = {"duration_s": lasting}
    scenario = case.scenario
    if scenario.pokes is not None:
        stronger = case.strength * scenario.pokes.acceleration_m_s2
        change["pokes"] = scenario.pokes.model_copy(update={"acceleration_m_s2": stronger})
    if scenario.breathing is not None:
        stronger = case.strength * scenario.breathing.acceleration_m_s2
        change["breathing"] = scenario.breathing.model_copy(update={"acceleration_m_s2": stronger})
    start, forces = start_and_forces(network, scenario.model_copy(update=change), rng)
    times = np.arange(0.0, lasting, KNOT_S)
    knots = np.zeros((len(times), *start.shape))
    for force in forces:
        knots += np.array([force(t) for t in times])
    true = {key: value * rng.uniform(1.0 - FORCE_ERROR, 1.0 + FORCE_ERROR) for key, value in STATED.items()}
    entry = network.positions[network.index(HIDDEN)] + ENTRY_M
    return World(
        case,
        network,
        SampledForces(knots, KNOT_S),
        needle_with(entry, true),
        pack(start, np.zeros_like(start)),
        rng.normal(0.0, case.mark_sd_m, (case.n_frames, len(OUTER), network.dim)),
        entry,
        rng.normal(size=network.dim),
        float(rng.uniform()),
    )


def needle_with(entry: Floats, constants: dict[str, float]) -> NeedleMechanics:
    """A needle of these constants, whose path is given elsewhere."""
    still = NeedlePose(entry, np.array([0.0, -1.0]), 0.0, 0.0)
    return NeedleMechanics(lambda _t: still, entry, **constants)
