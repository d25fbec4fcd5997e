"""Constants of the filters' numerics, varied for this study alone: no setting of a program changes them."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, fields
from importlib import import_module
from unittest.mock import patch

from estimators import FilterSettings
from experiments.studies.estimation.figures import estimation_figures

PLACES = {
    "longest_step_s": "estimators.process.process_model.LONGEST_STEP",
    "narrow": "estimators.filters.mixture.NARROW",
    "least_frames": "estimators.tissue.health.LEAST_FRAMES",
}
"""The module's constant of each name."""


def _now(name: str) -> float:
    module, _, constant = PLACES[name].rpartition(".")
    return float(getattr(import_module(module), constant))


@dataclass(frozen=True, slots=True)
class Constants:
    """Constants at the head of modules of estimation that are choices.

    longest_step_s: time between two additions of process noise, and longest integration step [s]; choice
    narrow: spread of sigma points that would leave the model's range, by the usual spread [1]; choice
    least_frames: frames whose innovations are tested together, at least [1]; choice
    """

    longest_step_s: float = _now("longest_step_s")
    narrow: float = _now("narrow")
    least_frames: int = int(_now("least_frames"))


def constants_figures(constants: Constants) -> Mapping[str, float]:
    """Figures of `estimation_figures` with these constants in place of the modules' own."""
    with ExitStack() as patched:
        for field in fields(constants):
            patched.enter_context(patch(PLACES[field.name], getattr(constants, field.name)))
        return estimation_figures(FilterSettings())
