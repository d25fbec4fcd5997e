"""What constants are identified from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from estimators.identification.budget import Budget
from estimators.identification.filter_pass import Frames
from estimators.tissue.settings import FilterSettings


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """What constants are identified from: frames, the nodes that may be poked and the target, filter's settings."""

    frames: Frames
    nodes: tuple[Sequence[str], str]
    settings: FilterSettings
    budget: Budget
