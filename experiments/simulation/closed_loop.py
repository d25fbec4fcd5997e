"""A needle driven into moving tissue by one policy, the loop closed: sight, estimate, command, and the tissue's answer.

At every frame the policy gives where the target is or will be, and the robot moves the needle's line towards it no
faster than it can. COMMIT_S before arrival the line is fixed: that is the commitment, at which a probability is given.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynamics import NeedleMotion
from estimators import (
    Advice,
    AdviceSettings,
    GaussianMixture,
    Hit,
    Insertion,
    Lesion,
    Needle,
    TargetPath,
    advise,
    hit_probability,
)
from experiments.arrays import Floats
from experiments.simulation.policies import Policy, predicted_parts, predicted_push
from experiments.simulation.world import World

COMMIT_S = 2.0 / 30.0
"""The line of the needle is fixed so long before arrival [s]: two frames, delays of the study's camera and robot."""

DEEPEST_M = 0.06
"""A needle that is so deep and has not met its target is drawn back or has missed [m]; a parameter of the study."""

SMALLEST_M, LARGEST_M = 2e-4, 10e-3
"""Between these, evenly by its logarithm, the lesion is drawn by which probabilities are judged [m]; of the study."""

BOUND = 0.9
"""A policy that may retract does so where a hit is less probable than this at the commitment; of the study."""

TIP = Needle(hit=Hit.TIP)
"""What hits, and how uncertain it is; `docs/guidance.md`."""

GOING = AdviceSettings(go=0.4, worth=0.05, horizon_s=0.3, step_s=0.1)
"""When to start: poked tissue cannot be predicted better half a second ahead; the commitment asks for BOUND."""


@dataclass(frozen=True, slots=True)
class Tried:
    """What came of one policy in one world.

    probability: of a hit in the lesion, given at the commitment; None where the policy gives none or never committed
    drawn_probability: the same for a lesion of drawn_radius_m, which is drawn
    miss_m: from the tip to the true target at arrival [m], None where the needle never arrived
    seconds: from leave to start until arrival [s]; insertions: begun
    """

    policy: str
    hit: bool
    miss_m: float | None
    seconds: float
    insertions: int
    probability: float | None
    drawn_probability: float | None
    drawn_radius_m: float


@dataclass(slots=True)
class _Robot:
    """Where the needle is: depth along its axis [m], beside its first line [m], and what it is doing."""

    axis: Floats
    depth: float = 0.0
    beside: float = 0.0
    doing: str = "waiting"
    insertions: int = 0
    punctured: bool = False

    @property
    def across(self) -> Floats:
        return np.array([-self.axis[1], self.axis[0]])


def attempt(world: World, policy: Policy, state: Floats, radius_m: float) -> Tried:
    """Drive the needle from the first frame after the warm-up on; `state`: the tissue's then, the policy warmed up."""
    case, lesion = world.case, Lesion.ball(radius_m, world.network.dim)
    first, dt = round(case.warm_s * case.frames_per_s), 1.0 / case.frames_per_s
    drawn_radius = SMALLEST_M * (LARGEST_M / SMALLEST_M) ** world.share
    robot = _Robot(np.array([0.0, -1.0]))
    begun_s, push = world.frame_s(first), None
    for k in range(first, case.n_frames - 1):
        now = world.frame_s(k)
        policy.see(now, world.marks(k, state), push)
        speed, sideways = 0.0, 0.0
        if robot.doing == "waiting":
            path = policy.path(_way(world, robot, case.speed_m_s))
            goal = _reached(path, world.entry, None, 0.0, case.speed_m_s)[1]
            if not policy.waits or _advises_go(policy, path, world, goal, lesion):
                way = goal - world.entry
                robot.axis, robot.beside = way / np.linalg.norm(way), 0.0
                robot.doing, robot.insertions = "going", robot.insertions + 1
        if robot.doing == "going":
            path = policy.path(_way(world, robot, case.speed_m_s))
            arrival, goal = _reached(path, world.entry, robot.axis, robot.depth, case.speed_m_s)
            left = arrival - now
            reach = case.steer_m_s * left
            aside = float((goal - world.entry) @ robot.across) - robot.beside
            if left <= COMMIT_S + 1e-9 or robot.depth > DEEPEST_M:
                shot = _aimed(world, policy, robot, (now, min(left, COMMIT_S)), float(np.clip(aside, -reach, reach)))
                p = shot.probability(lesion)
                if not policy.waits or (p is not None and p >= BOUND):
                    miss, seconds = shot.miss(world, robot, state), now + shot.left_s - begun_s
                    drawn = shot.probability(Lesion.ball(drawn_radius, lesion.dim))
                    hit = miss <= radius_m
                    return Tried(policy.name, hit, miss, seconds, robot.insertions, p, drawn, drawn_radius)
                robot.doing = "back"
            else:
                speed, sideways = case.speed_m_s, float(np.clip(aside / dt, -case.steer_m_s, case.steer_m_s))
        if robot.doing == "back":
            if robot.depth <= 0.0:
                robot.doing = "waiting"
            else:
                speed = -min(case.speed_m_s, robot.depth / dt)
        push = _way(world, robot, speed, steps=1)[0] if speed else None
        state, robot.punctured = world.moved(
            state, _drive(world, robot, speed, sideways), (now, world.frame_s(k + 1)), robot.punctured
        )
        robot.depth += speed * dt
        robot.beside += sideways * dt
    return Tried(policy.name, False, None, case.patience_s, robot.insertions, None, None, drawn_radius)


@dataclass(frozen=True, slots=True, eq=False)
class _Shot:
    """What was committed to: from a time on, for left_s [s], aside by so much [m]; where tip and target should be."""

    now_s: float
    left_s: float
    aside_m: float
    tip: GaussianMixture
    target: GaussianMixture | None
    axis: Floats

    def probability(self, lesion: Lesion) -> float | None:
        """Of a hit, None where there is no density of the target."""
        return None if self.target is None else hit_probability(self.target, self.tip, self.axis, lesion, needle=TIP)

    def miss(self, world: World, robot: _Robot, state: Floats) -> float:
        """From the tip to the true target at arrival [m]."""
        arrived = state
        if self.left_s > 0.0:
            drive = _drive(world, robot, world.case.speed_m_s, self.aside_m / self.left_s)
            arrived, _ = world.moved(state, drive, (self.now_s, self.now_s + self.left_s), robot.punctured)
        tip = self.tip.means[0] + np.linalg.cholesky(self.tip.covs[0]) @ world.tip_noise
        return float(np.linalg.norm(tip - world.target(arrived)))


def _aimed(world: World, policy: Policy, robot: _Robot, when: tuple[float, float], aside: float) -> _Shot:
    now, left = when
    speed = world.case.speed_m_s
    deep = robot.depth + speed * left
    tip = world.entry + deep * robot.axis + (robot.beside + aside) * robot.across
    parts = predicted_parts(world, robot.axis, robot.depth, robot.beside, speed, steps=1)[:, 0]
    target = policy.density_at(now + left, parts)
    return _Shot(now, left, aside, GaussianMixture.gaussian(tip, TIP.tip_cov(robot.axis, deep)), target, robot.axis)


def _drive(world: World, robot: _Robot, speed: float, sideways: float) -> NeedleMotion:
    tip = world.entry + robot.depth * robot.axis + robot.beside * robot.across
    inserted = robot.depth if robot.doing != "waiting" else -1.0
    return NeedleMotion(tip, speed * robot.axis + sideways * robot.across, robot.axis, inserted)


def _way(world: World, robot: _Robot, speed: float, steps: int = 0) -> Floats:
    """The predicted push of the needle in each of the coming frames [N], (n, n_free, dim)."""
    return predicted_push(world, robot.axis, robot.depth, robot.beside, speed, steps)


def _advises_go(policy: Policy, path: TargetPath, world: World, goal: Floats, lesion: Lesion) -> bool:
    if policy.fault(float(path.times_s[0])) is not None:
        return False
    insertion = Insertion(world.entry, goal - world.entry, world.case.speed_m_s)
    return advise(path, insertion, lesion, needle=TIP, settings=GOING).advice is Advice.GO


def _reached(path: TargetPath, entry: Floats, axis: Floats | None, depth: float, speed: float) -> tuple[float, Floats]:
    """When the tip is as deep as the target will be [s], and where that is; the path's end where it never is."""
    away = path.means - entry
    wanted = np.linalg.norm(away, axis=1) if axis is None else away @ axis
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
