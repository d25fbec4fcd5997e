"""Closed-loop insertion of a needle into moving tissue by one policy.

At every frame the policy estimates the target's present or future position, and the robot moves the needle's line
towards this position at a limited speed. The commitment takes place COMMIT_S before the arrival. From then on the line
is fixed. At the commitment the policy states a hit probability.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynamics import NeedleMotion
from estimators import (
    Advice,
    AdviceSettings,
    GaussianMixture,
    Insertion,
    Lesion,
    Needle,
    TargetPath,
    advise,
    hit_probability,
)
from estimators.guidance.path import CYCLE_S
from experiments.arrays import Floats
from experiments.simulation.policies import Policy, across, horizon_s, predicted_parts
from experiments.simulation.world import World

COMMIT_S = 2.0 / 30.0
"""Time before arrival at which the needle's line is fixed [s]: two frames, for the study's camera and robot."""

SMALLEST_M, LARGEST_M = 2e-4, 10e-3
"""Range of the log-uniform random lesion radius with which hit probabilities are tested [m]; parameter of the study."""

GOING = AdviceSettings(go=0.4, worth=0.05, horizon_s=0.3, step_s=0.1)
"""Thresholds of the hit probability for the start of an insertion. They are low, because poked tissue cannot be
predicted half a second ahead. At the commitment, the threshold is `go` of the needle's file."""


@dataclass(frozen=True, slots=True)
class Tried:
    """Result of one policy in one world.

    probability: hit probability at the commitment; None if the policy predicts none, or if there was no commitment
    drawn_radius_m: radius of a second lesion, random in each run [m]
    drawn_probability, drawn_hit: `probability` and `hit` for the second lesion
    miss_m: distance of the needle's tip or notch from the true target at arrival [m]; None if no needle arrived
    seconds: time from the end of the warm-up until arrival [s]
    insertions: number of insertions that were begun
    """

    policy: str
    hit: bool
    miss_m: float | None
    seconds: float
    insertions: int
    probability: float | None
    drawn_probability: float | None
    drawn_radius_m: float
    drawn_hit: bool | None = None


@dataclass(slots=True)
class _Robot:
    """The state of the needle.

    beside: sideways offset from the needle's initial line [m], (dim - 1,), in the directions `across(axis)`
    depth: depth of the tip along the axis [m]; doing: `waiting`, `going` or `back`
    """

    axis: Floats
    beside: Floats
    depth: float = 0.0
    doing: str = "waiting"
    insertions: int = 0
    punctured: bool = False

    def tip(self, entry: Floats, deeper: float = 0.0, aside: Floats | None = None) -> Floats:
        """Tip position [m], (dim,), after the needle moved `deeper` along the axis and `aside` across the axis [m]."""
        ways = self.beside if aside is None else self.beside + aside
        return np.asarray(entry + (self.depth + deeper) * self.axis + ways @ across(self.axis))


def within(ways: Floats, most: float) -> Floats:
    """The vector `ways`, shortened to the length `most` if it is longer."""
    length = float(np.linalg.norm(ways))
    return ways if length <= most else ways / length * most


def hits(needle: Needle, lesion: Lesion, offset: Floats, axis: Floats) -> bool:
    """Whether the needle hits. `offset` is the vector from the target to the tip or the notch's middle [m], (dim,)."""
    length, core = needle.sampled
    if core:
        return bool(lesion.core_lengths(offset[None], axis, length)[0] >= core)
    return bool(lesion.contains(offset[None])[0])


def attempt(world: World, policy: Policy, state: Floats) -> Tried:
    """Insert the needle with a policy; state: the tissue's state at the end of the warm-up."""
    case, plan = world.case, world.case.plan
    speed_m_s, still = plan.insertion.speed_m_s, np.zeros(plan.lesion.dim - 1)
    first, dt = round(case.warm_s * case.frames_per_s), 1.0 / case.frames_per_s
    robot, push = _Robot(plan.insertion.axis, still, punctured=world.pierced), None
    for k in range(first, case.n_frames - 1):
        now = world.frame_s(k)
        policy.see(now, world.marks(k, state), push)
        speed, sideways = 0.0, still
        if robot.doing == "waiting":
            path = policy.path(_way(world, robot, speed_m_s))
            goal = _reached(path, world, None, 0.0)[1]
            if not policy.waits or _advises_go(policy, path, world, goal):
                way = goal - world.entry
                robot.axis, robot.beside = way / np.linalg.norm(way), still
                robot.doing, robot.insertions = "going", robot.insertions + 1
        if robot.doing == "going" and policy.waits and policy.fault(now) is not None:
            robot.doing = "back"  # treated like ABORT
        if robot.doing == "going":
            path = policy.path(_way(world, robot, speed_m_s))
            arrival, goal = _reached(path, world, robot.axis, robot.depth)
            left = arrival - now
            reach = case.steer_m_s * left
            aside = across(robot.axis) @ (goal - world.entry) - robot.beside
            if left <= COMMIT_S + 1e-9 or robot.depth > case.deepest_m:
                tried = _committed(world, policy, robot, state, (now, min(left, COMMIT_S)), within(aside, reach))
                if tried is not None:
                    return tried
                robot.doing = "back"
            else:
                speed, sideways = speed_m_s, within(aside / dt, case.steer_m_s)
        if robot.doing == "back":
            if robot.depth <= 0.0:
                robot.doing = "waiting"
            else:
                speed = -min(speed_m_s, robot.depth / dt)
        push = None
        if speed:
            push = predicted_parts(world, robot.axis, robot.depth, robot.beside, speed, 1, dt)[:, 0].sum(axis=0)
        state, robot.punctured = world.moved(
            state, _drive(world, robot, speed, sideways), (now, world.frame_s(k + 1)), robot.punctured
        )
        robot.depth += speed * dt
        robot.beside = robot.beside + sideways * dt
    return Tried(policy.name, False, None, case.patience_s, robot.insertions, None, None, _drawn_radius_m(world))


def _committed(
    world: World, policy: Policy, robot: _Robot, state: Floats, when: tuple[float, float], aside_m: Floats
) -> Tried | None:
    """Result of an insertion from the commitment to the arrival; None if the policy retracts the needle.

    when: present time, and time until arrival [s]; aside_m: sideways motion in that time [m], (dim - 1,)
    """
    (now, left), case, plan, axis = when, world.case, world.case.plan, robot.axis
    needle, speed = plan.needle, plan.insertion.speed_m_s
    tip, cov = robot.tip(world.entry, speed * left, aside_m), needle.tip_cov(axis, robot.depth + speed * left)
    parts = predicted_parts(world, axis, robot.depth, robot.beside, speed, 1, 1.0 / case.frames_per_s)[:, 0]
    target = policy.density_at(now + left, parts)

    def probability(lesion: Lesion) -> float | None:
        if target is None:
            return None
        return hit_probability(target, GaussianMixture.gaussian(tip, cov), axis, lesion, needle=needle)

    p = probability(plan.lesion)
    if policy.waits and (p is None or p < plan.settings.go):
        return None
    arrived = state
    if left > 0.0:
        arrived, _ = world.moved(state, _drive(world, robot, speed, aside_m / left), (now, now + left), robot.punctured)
    offset = tip + tip_error(cov, world.tip_noise) - needle.reach_m * axis - world.target(arrived)
    drawn = Lesion.ball(_drawn_radius_m(world), plan.lesion.dim)
    return Tried(
        policy.name,
        hits(needle, plan.lesion, offset, axis),
        float(np.linalg.norm(offset)),
        now + left - world.frame_s(round(case.warm_s * case.frames_per_s)),
        robot.insertions,
        p,
        probability(drawn),
        float(drawn.axes[0, 0]),
        hits(needle, drawn, offset, axis),
    )


def _drawn_radius_m(world: World) -> float:
    """Random lesion radius of a run [m]; over the runs the radius is log-uniformly distributed."""
    return SMALLEST_M * float((LARGEST_M / SMALLEST_M) ** world.share)


def tip_error(cov: Floats, noise: Floats) -> Floats:
    """An error of the tip [m], (dim,), with covariance `cov` [m²], from standard normal numbers `noise`."""
    return np.linalg.cholesky(cov) @ noise if cov.any() else np.zeros(len(noise))


def _drive(world: World, robot: _Robot, speed: float, sideways: Floats) -> NeedleMotion:
    velocity = speed * robot.axis + sideways @ across(robot.axis)
    inserted = robot.depth if robot.doing != "waiting" else -1.0
    return NeedleMotion(robot.tip(world.entry), velocity, robot.axis, inserted)


def _way(world: World, robot: _Robot, speed: float) -> Floats:
    """Predicted needle forces [N] in successive steps of CYCLE_S, over the prediction range, (n, n_free, dim)."""
    n = round(horizon_s(world) / CYCLE_S)
    return predicted_parts(world, robot.axis, robot.depth, robot.beside, speed, n, CYCLE_S).sum(axis=0)


def _advises_go(policy: Policy, path: TargetPath, world: World, goal: Floats) -> bool:
    if policy.fault(float(path.times_s[0])) is not None:
        return False
    plan = world.case.plan
    insertion = Insertion(world.entry, goal - world.entry, plan.insertion.speed_m_s)
    return advise(path, insertion, plan.lesion, needle=plan.needle, settings=GOING).advice is Advice.GO


def _reached(path: TargetPath, world: World, axis: Floats | None, depth: float) -> tuple[float, Floats]:
    """Time at which the needle is as deep as the target [s], and the target's position then [m], (dim,).

    If the path ends earlier, the result is the time and the position at the end of the path.
    axis: direction of the needle; None for a needle that is turned towards the target
    """
    plan = world.case.plan
    speed, away = plan.insertion.speed_m_s, path.means - world.entry
    wanted = (np.linalg.norm(away, axis=1) if axis is None else away @ axis) + plan.needle.reach_m
    ahead = depth + speed * (path.times_s - path.times_s[0]) - wanted
    if ahead[0] >= 0.0:
        return float(path.times_s[0]), path.means[0]
    there = np.flatnonzero(ahead >= 0.0)
    if not len(there):
        return float(path.times_s[-1]), path.means[-1]
    j = int(there[0])
    share = -ahead[j - 1] / (ahead[j] - ahead[j - 1])
    at = path.times_s[j - 1] + share * (path.times_s[j] - path.times_s[j - 1])
    return float(at), (1.0 - share) * path.means[j - 1] + share * path.means[j]
