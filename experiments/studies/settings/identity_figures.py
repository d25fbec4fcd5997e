"""What the settings of association over time are worth: marks given wrong names, or none, on simulated phantoms.

    python -m experiments.studies.settings.sensitivity --out DIR --only identity

Runs of `experiments.studies.identity` on seeds that it does not report on, masses close together, marks with so much
noise that one frame does not decide. `wrong springs`: names are right, and the filter takes springs as 1.4 times as
stiff. `from the start`: names are permuted. `seldom`: nobody gives names, and there are 5 frames/s.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from dynamics import OUTER
from estimators.association import IdentitySettings
from experiments.arrays import Floats
from experiments.studies.identity import FRAMES_PER_S, World, nameless_run, reported_names, reported_run, world

SEEDS = (903, 904)
"""Above those of the study of identity, which counts from 0."""

MOTIONS = ("poked", "shoved")

NOISE_M: Mapping[str, float] = {"wrong springs": 0.03, "from the start": 0.03, "seldom": 0.015}
"""Standard deviation of a mark an axis by kind of run [m]; marks are some 84 mm apart."""


@cache
def _seen(how: str, seed: int) -> World:
    return world("close", how, seed)


def _noisy(how: str, seed: int, noise_m: float) -> World:
    one = _seen(how, seed)
    more = np.random.default_rng([seed, 4]).normal(0.0, np.sqrt(noise_m**2 - one.noise_m**2), one.marks.shape)
    return replace(one, marks=one.marks + more, noise_m=noise_m)


def identity_figures(
    settings: IdentitySettings, seeds: Sequence[int] = SEEDS, motions: Sequence[str] = MOTIONS
) -> dict[str, float]:
    """How soon wrong names are mended, how often right ones are changed, and what following others costs.

    wrong_s: mean time with wrong names, permuted from the start [s]; mended: share of these runs that end well
    false_swaps: mean number of changes of names that were right
    followed: share of the frames in which other names are followed; error_mm: mean rms error at the end
    seldom_wrong: mean number of frames with wrong names where nobody gives any; seldom_mm: median rms error at the end
    """
    rows: dict[str, list[Mapping[str, object]]] = {kind: [] for kind in NOISE_M}
    for seed in seeds:
        for how in motions:
            for kind, noise_m in NOISE_M.items():
                one = _noisy(how, seed, noise_m)
                if kind == "seldom":
                    rows[kind].append(nameless_run(one, kind, [tuple(OUTER)], settings=settings))
                else:
                    reported = reported_names(kind, np.random.default_rng([seed, 3]))
                    rows[kind].append(reported_run(one, kind, reported, [tuple(OUTER)], settings=settings))
    n_frames = len(_seen(motions[0], seeds[0]).times_s)
    right, permuted, seldom = (rows[kind] for kind in NOISE_M)
    return {
        "wrong_s": float(_column(permuted, "wrong_frames").mean()) / FRAMES_PER_S,
        "mended": 1.0 - float(_column(permuted, "wrong_end").mean()),
        "false_swaps": float(_column(right, "swaps").mean()),
        "followed": float(_column([*right, *permuted], "doubts").mean()) / n_frames,
        "error_mm": float(_column([*right, *permuted], "end_mm").mean()),
        "seldom_wrong": float(_column(seldom, "wrong_frames").mean()),
        "seldom_mm": float(np.median(_column(seldom, "end_mm"))),
    }


def _column(rows: Sequence[Mapping[str, object]], name: str) -> Floats:
    return np.array([row[name] for row in rows], dtype=np.float64)
