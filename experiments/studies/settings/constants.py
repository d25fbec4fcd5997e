"""Constants of the filters' numerics, varied for this study alone: no setting of a program changes them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any
from unittest.mock import patch

from estimators import FilterSettings
from experiments.studies.estimation.figures import estimation_figures

PLACES = {
    "longest_step_s": "estimators.process.process_model.LONGEST_STEP",
    "narrow": "estimators.filters.mixture.NARROW",
    "least_frames": "estimators.tissue.health.LEAST_FRAMES",
    "information": "estimators.filters.noise_level.INFORMATION",
}
"""The module's constant of each name."""


def constant(place: str) -> float:
    """The constant at this place, `package.module.NAME`."""
    module, _, name = place.rpartition(".")
    return float(getattr(import_module(module), name))


@contextmanager
def constants_in_place(values: Any, places: Mapping[str, str]) -> Iterator[None]:
    """Within it, the constants at these places have the values of the record's fields of these names."""
    with ExitStack() as patched:
        for name, place in places.items():
            patched.enter_context(patch(place, getattr(values, name)))
        yield


@dataclass(frozen=True, slots=True)
class Constants:
    """Constants at the head of modules of estimation that are choices.

    longest_step_s: time between two additions of process noise, and longest integration step [s]; choice
    narrow: spread of sigma points that would leave the model's range, by the usual spread [1]; choice
    least_frames: frames whose innovations are tested together, at least [1]; choice
    information: how many independent coordinates the stated level of white noise is worth [1]; choice
    """

    longest_step_s: float = constant(PLACES["longest_step_s"])
    narrow: float = constant(PLACES["narrow"])
    least_frames: int = int(constant(PLACES["least_frames"]))
    information: float = constant(PLACES["information"])


def constants_figures(constants: Constants) -> Mapping[str, float]:
    """Figures of `estimation_figures` with these constants in place of the modules' own."""
    with constants_in_place(constants, PLACES):
        return estimation_figures(FilterSettings())
