"""What the noise of a tracked needle is worth: predicted arrivals on simulated insertions.

    python -m experiments.studies.settings.sensitivity --out DIR --only needle

A needle starts from rest, goes at 20 to 60 mm/s that waver as a hand's do, and bends by 0.02 of its depth [deflection].
Its tip is seen to 0.5 mm an axis, 30 times a second. The insertions are no published study's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators import Needle, NeedleNoise, NeedleTracker, coverage, normalised_error_squared
from experiments.arrays import Floats

SEEDS = range(601, 661)
FRAMES_PER_S = 30
SPEEDS_M_S = (0.02, 0.06)
START_S, WAVER, WAVER_S = 0.15, 0.15, 0.3
"""Time constant of the start [s]; relative standard deviation of the speed, and its correlation time [s]."""

AIM_M = 0.05
"""Depth at which the target lies [m]."""

AHEAD_S = 0.3
"""The tip is predicted so far ahead [s]."""

EARLY_S = 0.3
"""An arrival is an early one so long after the first sight of the tip [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Pushed:
    """One insertion along y: times [s] (n,), tips and where they are seen [m], (n, 2)."""

    times_s: Floats
    tips: Floats
    seen: Floats

    @property
    def arrival_s(self) -> float:
        """When the tip was at AIM_M [s]."""
        return float(np.interp(AIM_M, self.tips[:, 1], self.times_s))


def pushed(seed: int) -> Pushed:
    """An insertion until the tip is well beyond the target; first sight of it at the skin, at rest."""
    rng, dt = np.random.default_rng(seed), 1.0 / FRAMES_PER_S
    speed = float(rng.uniform(*SPEEDS_M_S))
    times = dt * np.arange(int(np.ceil((2.0 * AIM_M / speed + 1.0) / dt)), dtype=np.float64)
    waver = np.zeros(len(times))
    decay = np.exp(-dt / WAVER_S)
    for k in range(1, len(times)):
        waver[k] = decay * waver[k - 1] + WAVER * np.sqrt(1.0 - decay**2) * rng.standard_normal()
    speeds = speed * -np.expm1(-times / START_S) * np.maximum(1.0 + waver, 0.1)
    depths = np.r_[0.0, np.cumsum(0.5 * dt * (speeds[1:] + speeds[:-1]))]
    bent = Needle().bending_sd * rng.standard_normal() * depths
    tips = np.stack([bent, depths], axis=1)
    return Pushed(times, tips, tips + rng.normal(0.0, Needle().tip_sd_m, tips.shape))


def needle_figures(noise: NeedleNoise, seeds: Sequence[int] = SEEDS) -> dict[str, float]:
    """Rms error, and coverage of the 95 % region, of predicted arrivals and of the tip AHEAD_S ahead.

    arrival_ms, arrival_coverage: asked in each frame between EARLY_S and the arrival
    early_ms, early_coverage: within EARLY_S; early_ms is the median error, for a slow start is far out
    tip_mm, tip_coverage: of the predicted tip, in the plane, after EARLY_S
    """
    errors: dict[bool, list[tuple[float, float]]] = {True: [], False: []}
    errors_m, covs = [], []
    cov = Needle().tip_sd_m ** 2 * np.eye(2)
    for seed in seeds:
        one = pushed(seed)
        tracker = NeedleTracker([0.0, 0.0], [0.0, 1.0], noise)
        for k, time_s in enumerate(one.times_s):
            if time_s + AHEAD_S > one.times_s[-1] or time_s >= one.arrival_s:
                break
            tracker.predict(float(time_s))
            tracker.update(one.seen[k], cov)
            if time_s > EARLY_S:
                ahead, ahead_cov = tracker.tip_at(float(time_s) + AHEAD_S)
                errors_m.append(ahead - [np.interp(time_s + AHEAD_S, one.times_s, one.tips[:, a]) for a in range(2)])
                covs.append(ahead_cov)
            arrival = tracker.arrival(AIM_M)
            if arrival is not None:
                errors[bool(time_s <= EARLY_S)].append((arrival.time_s - one.arrival_s, arrival.sd_s))
    found = {}
    for name, early in (("arrival", False), ("early", True)):
        error, sd = np.array(errors[early]).T
        found[f"{name}_ms"] = 1e3 * float(np.median(np.abs(error)) if early else np.sqrt(np.mean(error**2)))
        found[f"{name}_coverage"] = coverage((error / sd) ** 2, 1)
    nees = normalised_error_squared(np.array(errors_m), np.array(covs))
    return found | {
        "tip_mm": 1e3 * float(np.sqrt(np.mean(np.sum(np.square(errors_m), axis=1)))),
        "tip_coverage": coverage(nees, 2),
    }
