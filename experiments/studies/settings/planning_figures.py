"""What the assumptions about a planned needle are worth: plans on the phantom, judged by a needle as stated.

    python -m experiments.studies.settings.sensitivity --out DIR --only planning

The lesion is at the hidden mass, the skin above it. A plan's best path is judged by the forces of the defaults, with
one factor of error on them.
"""

from __future__ import annotations

import numpy as np

from dynamics import HIDDEN, four_mass_phantom
from estimators import PlannedNeedle, PlannedTarget, Skin, candidate_paths, plan

RADIUS_M, BELIEF_SD_M = 5e-3, 2e-3
SKIN = Skin(np.array([-0.13, 0.268]), np.array([0.13, 0.268]), np.array([0.0, 1.0]), np.radians(60.0), 0.15)
N_ENTRIES = 40


def planning_figures(needle: PlannedNeedle, n_entries: int = N_ENTRIES) -> dict[str, float]:
    """Predicted shift and hit probabilities, and what the best path is worth to a needle of the defaults.

    shift_mm: of the target, mean of all paths; best_hit, mean_hit: probability by the best path, mean of all
    stated_hit: probability by the best path for a needle of the default forces, kernel and errors
    """
    network = four_mass_phantom()
    lesion = PlannedTarget(network.positions[network.index(HIDDEN)], BELIEF_SD_M**2 * np.eye(2), RADIUS_M)
    entries, tips = candidate_paths(network, HIDDEN, lesion, needle, SKIN.entries(n_entries), 5)
    found = plan(network, HIDDEN, lesion, needle, SKIN, (), entries=entries, tips=tips)
    best = found.order[:1]
    stated = plan(
        network, HIDDEN, lesion, PlannedNeedle(), SKIN, (), entries=found.entries[best], tips=found.tips[best]
    )
    return {
        "shift_mm": 1e3 * float(np.linalg.norm(found.pushed, axis=1).mean()),
        "best_hit": float(found.hits[best[0]]),
        "mean_hit": float(found.hits.mean()),
        "stated_hit": float(stated.hits[0]),
    }
