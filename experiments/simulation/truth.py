"""Where the nodes of a simulated tissue truly were."""

from __future__ import annotations

from dataclasses import dataclass

from experiments.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Where the free nodes were: times_s (n,), positions of the network's free nodes [m], (n, n_free, dim)."""

    times_s: Floats
    positions: Floats
