"""The case of a simulated insertion: the scenario's tissue, the filter's scene, the needle and the lesion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dynamics import MassSpringNetwork, rest_shape, supported
from estimators import AdviceSettings, FilterSettings, Hit, Insertion, Lesion, Needle
from estimators.process.target import target_map
from experiments.arrays import Floats
from experiments.errors import InputError, shown
from experiments.formats.needle_file import NeedlePlan, read_needle
from experiments.formats.scenario import Scenario, SeenMarks
from experiments.formats.scene.mesh import ON_SKIN_M, outside_m, with_line
from experiments.formats.scene.scene import Scene, usable_scene
from experiments.formats.scene.schema import where
from experiments.simulation.simulate import EXACT, scene_of

FIRST_SEED = 30_000
"""Smallest seed of reported runs. Settings were chosen with smaller seeds."""

BREATHING_WARM_S = 12.0
"""Time in which the filter processes marks of breathing tissue before a needle may start [s]; choice: two breaths."""

ENTRY_M = (0.015, 0.020)
"""Vector from the resting target to the needle's entry in the phantom [m], 25 mm long; a parameter of the study."""

SPEED_M_S = 0.05
"""Speed of a needle without a file [m/s]."""

DEEPEST_M = 0.06
"""Depth of a needle in the phantom beyond which an insertion ends [m]; a parameter of the study."""

BEYOND_M = 0.035
"""Largest distance that a needle's tip moves beyond the resting target in a user's scene [m]; a choice."""

ONE_AT_A_TIME = FilterSettings(poked=replace(FilterSettings().poked, poke=3.4), discrepancy=EXACT)
"""Filter settings for pokes that act on one outer mass at a time. In scenario `poked` a poke has a random direction and
a random peak of 3 to 10 m/s². Its acceleration is half a sine over time, with an rms of 3.4 m/s² on each axis."""

TOGETHER = FilterSettings(discrepancy=EXACT)
"""Filter settings for forces that act on all outer masses together."""

FAR_M, N_ALONG = 0.05, 100
"""FAR_M is the largest distance of a needle's entry from a body of tetrahedra [m]; choice: a probe between robot and
skin is short. N_ALONG is the number of points on the needle's line whose distance from the body is tested."""

ELSEWHERE = 0.1
"""Largest shift of a mark between the filter's scene and the scenario's scene [1], relative to the body's size; choice:
sagging, registration or another mesh of the same body cause smaller shifts."""

AT_REST_M = 1e-9
"""Largest distance between drawn and rest positions that count as equal [m]; numerical: rounding."""

TIP = Needle(hit=Hit.TIP)
"""The needle if no needle file is stated; its tip has to hit the target."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Case:
    """The data that determine one run of the insertion study, except the policy.

    truth: scene of the true tissue in its rest shape
    given: scene that the filter uses
    straight: insertion without steering, for the test of `softaim advise`
    deepest_m: depth of the needle at which the insertion ends, even if the target is farther away [m]
    steer_m_s: largest speed with which the robot moves the needle's line sideways [m/s]
    seen: errors of the simulated marks
    warm_s: duration of the warm-up, in which the filter processes marks without a needle [s]
    patience_s: longest time from the end of the warm-up until the needle's arrival [s]
    strength: factor on the forces of the scenario's pokes and breathing
    advice: whether the run also tests `softaim advise`
    """

    scenario: Scenario
    seed: int
    truth: Scene
    given: Scene
    plan: NeedlePlan
    straight: Insertion
    deepest_m: float = DEEPEST_M
    steer_m_s: float = 0.05
    frames_per_s: float = 30.0
    seen: SeenMarks = SeenMarks()
    warm_s: float = 3.0
    patience_s: float = 10.0
    strength: float = 1.0
    advice: bool = True

    def __repr__(self) -> str:
        return f"Case(scenario={self.scenario.scene or self.scenario.title!r}, seed={self.seed})"

    @property
    def n_frames(self) -> int:
        """Number of camera frames from the start of the warm-up until `patience_s` after its end."""
        return int(np.ceil((self.warm_s + self.patience_s) * self.frames_per_s)) + 1


def case_of(
    scenario: Scenario,
    *,
    scene_path: Path | None = None,
    needle_path: Path | None = None,
    speed_m_s: float | None = None,
    radius_m: float | None = None,
    strength: float = 1.0,
) -> Case:
    """The case of the first run of a scenario; raises InputError if the files do not fit together.

    scene_path: file of the scene that the filter uses; by default the filter uses the scenario's scene
    speed_m_s: needle speed [m/s], in place of the speed in the needle file
    radius_m: lesion radius [m], in place of the lesion in the needle file
    """
    if radius_m is not None and not 0.0 < radius_m < 1.0:
        raise InputError.at("--radius-mm", "more than 0 and less than 1000", f"{1e3 * radius_m:g}")
    own = scene_of(scenario)
    truth = replace(own, network=at_rest(own.network), cameras=(), space_cameras=())
    given = truth if scene_path is None else replace(usable_scene(scene_path), cameras=(), space_cameras=())
    if scene_path is not None:
        _check_given(scene_path, given, truth)
    of_phantom = scenario.scene is None
    if of_phantom and scene_path is None:
        given = replace(given, settings=settings_for(scenario))
    plan = usual_plan(truth, of_phantom=of_phantom)
    if needle_path is not None:
        plan = read_needle(needle_path, own.target.radius_m, own.network.dim)
    if speed_m_s is not None:
        plan = replace(plan, insertion=replace(plan.insertion, speed_m_s=speed_m_s))
    if radius_m is not None:
        plan = replace(plan, lesion=Lesion.ball(radius_m, own.network.dim))
    usual = of_phantom and needle_path is None
    ahead = resting_target(truth) - plan.insertion.entry
    deepest_m = DEEPEST_M if usual else way_m(truth, plan) + BEYOND_M
    line = plan.insertion.entry + np.array([[0.0], [deepest_m]]) * plan.insertion.axis
    if needle_path is not None and ahead @ plan.insertion.axis <= 0.0:
        raise InputError.at(f"{needle_path}: direction", "a direction toward the target", "one away from it")
    if needle_path is not None and truth.mesh is not None:
        away_m = outside_m(truth.mesh, np.linspace(line[0], line[1], N_ALONG))
        if away_m[0] > FAR_M:
            expected, found = f"a place within {1e3 * FAR_M:g} mm of the body", f"{1e3 * away_m[0]:.3g} mm outside"
            raise InputError.at(f"{needle_path}: entry_mm", expected, found)
        if away_m.min() > ON_SKIN_M:
            raise InputError.at(f"{needle_path}: direction", "a direction into the body", "one past it")
    return Case(
        scenario,
        FIRST_SEED if of_phantom else scenario.seed,
        with_needle(truth, line),
        with_needle(given, line),
        plan,
        replace(plan.insertion, axis=ahead) if usual else plan.insertion,
        deepest_m=deepest_m,
        frames_per_s=30.0 if of_phantom else 1.0 / scenario.frame_interval_s,
        seen=scenario.seen,
        warm_s=3.0 if scenario.breathing is None else BREATHING_WARM_S,
        strength=strength,
    )


def with_needle(scene: Scene, line: Floats) -> Scene:
    """The scene with additional mesh points between the ends `line` [m], (2, dim). Without a mesh nothing changes."""
    if scene.mesh is None:
        return scene
    mesh, network = with_line(scene.mesh, scene.network, line)
    return replace(scene, mesh=mesh, network=network)


def settings_for(scenario: Scenario) -> FilterSettings:
    """Filter settings for the phantom: TOGETHER if the forces act on all outer masses together, else ONE_AT_A_TIME."""
    together = scenario.breathing is not None or (scenario.pokes is not None and scenario.pokes.together)
    return TOGETHER if together else ONE_AT_A_TIME


def at_rest(network: MassSpringNetwork) -> MassSpringNetwork:
    """The network, drawn in its rest shape. If it has no anchors, its gravity is set to 0, see `supported`."""
    network = supported(network)
    shape = rest_shape(network)
    return network if np.abs(shape - network.positions).max() <= AT_REST_M else replace(network, positions=shape)


def resting_target(scene: Scene) -> Floats:
    """Position of the target in the network as drawn [m], (dim,)."""
    network = scene.network
    return target_map(network, scene.target.point).position(network.positions[network.free].ravel())


def way_m(scene: Scene, plan: NeedlePlan) -> float:
    """Depth of a needle's tip when the needle has reached the resting target [m]."""
    return float(np.linalg.norm(resting_target(scene) - plan.insertion.entry)) + plan.needle.reach_m


def usual_plan(scene: Scene, *, of_phantom: bool) -> NeedlePlan:
    """The plan if no needle file is stated: the needle points down, along gravity.

    In a user's scene the needle enters above the resting target, at the height of the highest node, but at least
    25 mm above the target, as in the phantom.
    """
    network, target = scene.network, resting_target(scene)
    weight = float(np.linalg.norm(network.gravity))
    up = -network.gravity / weight if weight > 0.0 else np.eye(network.dim)[1]
    height = float((network.positions @ up).max() - target @ up)
    entry = target + (ENTRY_M if of_phantom else max(height, float(np.linalg.norm(ENTRY_M))) * up)
    insertion = Insertion(entry, -up, SPEED_M_S)
    return NeedlePlan(TIP, insertion, Lesion.ball(scene.target.radius_m, network.dim), AdviceSettings())


def _check_given(path: Path, given: Scene, truth: Scene) -> None:
    """Raise InputError if the filter's scene, read from `path`, does not fit the scene of the true tissue."""
    if given.network.dim != truth.network.dim:
        expected = f"a body {where(truth.network.dim)}, as in the scenario's scene"
        table = "network" if given.mesh is None else "mesh"
        raise InputError.at(f"{path}: {table}", expected, f"one {where(given.network.dim)}")
    free = {truth.network.names[i] for i in truth.network.free}
    for i, mark in enumerate(given.marks):
        if mark.measured and mark.node not in free:
            raise InputError.at(f"{path}: mark[{i}].node", "a free node of the scenario's scene", shown(mark.node))
    most = ELSEWHERE * float(np.linalg.norm(np.ptp(truth.network.positions, axis=0)))
    if given.target.node != truth.target.node:
        expected = f"{shown(truth.target.node)}, as in the scenario's scene"
        raise InputError.at(f"{path}: target.node", expected, shown(given.target.node))
    for node in (*given.measured_nodes, truth.target.node):
        places = (scene.network.positions[scene.network.index(node)] for scene in (given, truth))
        if (apart := float(np.linalg.norm(np.subtract(*places)))) > most:
            expected = f"{node} within {1e3 * most:.3g} mm of its place in the scenario's scene"
            raise InputError.at(path, expected, f"{1e3 * apart:.3g} mm")
