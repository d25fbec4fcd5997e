"""The settings records of the project and the figures that each serves, for `experiments.studies.sensitivity`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from experiments.studies.marks import marks_figures
from vision.tracking.settings import FINDER

Figures = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Family:
    """A settings record and the function that gives the figures it serves."""

    record: Any
    figures: Callable[[Any], Figures]


FAMILIES: dict[str, Family] = {"marks": Family(FINDER, marks_figures)}
