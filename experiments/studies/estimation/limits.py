"""Parts of the study at its limits: comparison with the lower bound, strong disturbances, no marks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics import HIDDEN, OUTER, four_mass_phantom, pack
from estimators import ForceMode, TissueFilter, posterior_bound
from experiments.arrays import Floats
from experiments.engine.runs import Case
from experiments.studies.estimation.trials import EXACTLY, KNOTS_PER_S, Model, Trial, run, truth

TREMOR = 0.05
"""White acceleration of the shipped scenarios on each free node [m/s²/sqrt(Hz)]."""

SECTIONS = {"from the first frame": 0, "after 2 s": 60}
"""First counted frame of a run, for each section."""


def hard_trial(k: int) -> Trial:
    """One of the thousand runs: random frame rate, noise and strength of pokes, three marks in ten lost."""
    rng = np.random.default_rng([k, 3])
    return Trial(
        "poked" if k % 2 else "shoved",
        5000 + k,
        duration_s=6.0,
        frames_per_s=int(rng.choice([5, 10, 15, 30, 60, 120])),
        mark_sd_m=float(np.exp(rng.uniform(np.log(0.0005), np.log(0.008)))),
        strength=float(rng.choice([1.0, 1.25, 1.5])),
        lost=0.3,
    )


def bound_row(case: Case, cache: Path) -> list[dict[str, Any]]:
    """Mean square error of the filter in a quiet run, and the posterior Cramér-Rao bound, by section."""
    network, trial = four_mass_phantom(), Trial("quiet", case["seed"])
    positions = truth(trial, cache)
    dt, every = 1.0 / KNOTS_PER_S, KNOTS_PER_S // trial.frames_per_s
    states = pack(positions, np.gradient(positions, dt, axis=0))
    mark = trial.mark_sd_m**2 * np.eye(2)
    seen_marks = [dict.fromkeys(OUTER, mark) if k % every == 0 else {} for k in range(len(states))]
    n = network.n_state
    start = TissueFilter(network, HIDDEN, OUTER, EXACTLY).process.prior(0.0)[1][0, :n, :n]
    tremor = ForceMode(white=TREMOR, poke=1e-9, lasting_s=1.0)
    times = dt * np.arange(len(states))
    place = network.coordinates(HIDDEN)
    covs = posterior_bound(network, states, times, seen_marks, tremor, start)[::every, place, place]
    squared, bound = run(trial, Model(), cache).filtered ** 2, np.trace(covs, axis1=1, axis2=2)
    return [
        {"from": label, "square_m2": float(squared[first:].mean()), "bound_m2": float(bound[first:].mean())}
        for label, first in SECTIONS.items()
    ]


def longest(times_s: Floats, wrong: NDArray[np.bool_]) -> float:
    """The longest duration [s] of consecutive frames in which `wrong` is true."""
    found, since = 0.0, None
    for time_s, now in zip(times_s, wrong, strict=True):
        since = (time_s if since is None else since) if now else None
        found = max(found, 0.0 if since is None else float(time_s - since))
    return found
