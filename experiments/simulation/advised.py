"""Reliability of the hit probabilities that `softaim advise` predicts.

Every second, the filter gives advice as in `softaim advise`. A needle is then inserted immediately into the true
deforming tissue, straight along its direction and without steering, to the advised depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np

from dynamics import NeedleMotion
from estimators import (
    Advice,
    Guidance,
    ReliabilityBin,
    TargetPath,
    clopper_pearson,
    guide,
    path_near_rest,
    reliability_bins,
)
from experiments.arrays import Floats
from experiments.simulation.closed_loop import hits, tip_error
from experiments.simulation.policies import Warm
from experiments.simulation.world import World

EVERY_S = 1.0
"""Time between two pieces of advice in a run [s]; parameter of the study: insertions become nearly independent."""


@dataclass(frozen=True, slots=True)
class AdvisedInsertion:
    """Advice at one time, and the result of the insertion that follows this advice.

    probability: predicted hit probability; hit: whether the needle hit the lesion
    miss_m: distance of the tip or the notch from the target at arrival [m]
    If no needle was inserted, probability, hit and miss_m are None.
    """

    time_s: float
    advice: Advice
    probability: float | None = None
    hit: bool | None = None
    miss_m: float | None = None


def advised(world: World, warm: Warm, state: Floats) -> tuple[AdvisedInsertion, ...]:
    """Results of insertions that follow advice. Advice is given every EVERY_S, from the end of the warm-up on."""
    case, tissue = world.case, warm.tissue
    plan = case.plan
    tissue.restore(warm.then)
    rng = np.random.default_rng([case.seed, 9])
    push = plan.push_on(case.given.network, case.given.target.point)

    def path_at(times_s: Floats) -> TargetPath:
        return push.pushed(path_near_rest(warm.of_advice, tissue, times_s), case.straight)

    asked = partial(guide, needle=plan.needle, settings=plan.settings, path_at=path_at)
    first, every = round(case.warm_s * case.frames_per_s), max(1, round(EVERY_S * case.frames_per_s))
    until_s = world.knots.interval_s * (len(world.knots.forces) - 1)
    found = []
    for k in range(first, case.n_frames - 1):
        now = world.frame_s(k)
        tissue.predict(now)
        estimate = tissue.update(world.marks(k, state))
        if (k - first) % every == 0:
            guidance = asked(tissue, estimate, case.straight, plan.lesion)
            found.append(inserted(world, guidance, (now, until_s), state, rng.normal(size=world.network.dim)))
        state = world.untouched(state, k)
    return tuple(found)


def inserted(
    world: World, guidance: Guidance, between_s: tuple[float, float], state: Floats, tip_noise: Floats
) -> AdvisedInsertion:
    """Result of an insertion that follows advice. `between_s` has its start and the latest permitted arrival [s]."""
    (now, until_s), plan = between_s, world.case.plan
    arrival_s, deeper, p = guidance.arrival_s, guidance.depth_m, guidance.probability
    if arrival_s is None or deeper is None or p is None or arrival_s > until_s:
        return AdvisedInsertion(now, guidance.advice)
    insertion, axis = world.case.straight, world.case.straight.axis
    arrived, started = state, insertion.depth_m
    if arrival_s > now:
        tip = world.entry + started * axis
        drive = NeedleMotion(tip, insertion.speed_m_s * axis, axis, started)
        arrived, _ = world.moved(state, drive, (now, arrival_s), punctured=started > 0.0 or world.pierced)
    depth = started + deeper
    error = tip_error(plan.needle.tip_cov(axis, depth), tip_noise)
    offset = world.entry + (depth - plan.needle.reach_m) * axis + error - world.target(arrived)
    hit = hits(plan.needle, plan.lesion, offset, axis)
    return AdvisedInsertion(now, guidance.advice, p, hit, float(np.linalg.norm(offset)))


def advice_figures(runs: Sequence[Sequence[AdvisedInsertion]]) -> dict[str, object]:
    """Predicted and observed hit rates: of all insertions, of insertions after GO, and in bins of the probability."""
    known = [[one for one in run if one.probability is not None] for run in runs]
    go = [[one for one in run if one.advice is Advice.GO] for run in known]
    return {
        "advice": {str(name): sum(one.advice is name for run in runs for one in run) for name in Advice},
        **_compared(known, ""),
        **_compared(go, "go_"),
        "bins": [asdict(row) for row in bins(runs)],
    }


def bins(runs: Sequence[Sequence[AdvisedInsertion]]) -> tuple[ReliabilityBin, ...]:
    """Observed hit rate in each of ten bins of the predicted probability."""
    known = [(one.probability, bool(one.hit)) for run in runs for one in run if one.probability is not None]
    return reliability_bins([probability for probability, _ in known], [hit for _, hit in known])


def _compared(runs: Sequence[Sequence[AdvisedInsertion]], key: str) -> dict[str, float | int | None]:
    """Number of insertions, predicted and observed hit rate, 95 % interval, difference with its standard deviation."""
    stated = [np.array([one.probability for one in run], dtype=float) for run in runs if run]
    came = [np.array([bool(one.hit) for one in run], dtype=float) for run in runs if run]
    n = sum(len(run) for run in stated)
    names = ("predicted", "observed", "observed_low", "observed_high", "difference", "difference_sd")
    if not n:
        return {f"{key}insertions": 0, **{f"{key}{name}": None for name in names}}
    predicted, hit = float(np.concatenate(stated).mean()), float(np.concatenate(came).mean())
    low, high = clopper_pearson(int(sum(run.sum() for run in came)), n, 0.95)
    values = (predicted, hit, low, high, hit - predicted, _spread_over_runs(stated, came))
    return {f"{key}insertions": n, **{f"{key}{name}": value for name, value in zip(names, values, strict=True)}}


def _spread_over_runs(stated: Sequence[Floats], came: Sequence[Floats]) -> float | None:
    """Standard deviation of the difference in `_compared`, by a jackknife over runs; None for one run."""
    sums = np.array([float((c - s).sum()) for s, c in zip(stated, came, strict=True)])
    sizes = np.array([len(run) for run in stated])
    n = len(sums)
    if n < 2:
        return None
    without = (sums.sum() - sums) / (sizes.sum() - sizes)
    return float(np.sqrt((n - 1) / n * np.square(without - without.mean()).sum()))
