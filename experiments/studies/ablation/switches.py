"""The mechanisms of the filter that the study turns off one at a time."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any
from unittest.mock import patch

import numpy as np

from estimators import TissueFilter
from estimators.core import Discrepancy, Disturbances, HypothesisFilter
from experiments.studies.ablation.recordings import Recording

WHOLE = "whole filter"

FORCES, FIELD = Disturbances(), Discrepancy()
"""Default priors of the filter, for the forces on the tissue and for the displacements that the model lacks."""

Fields = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Switch:
    """A mechanism of the filter, and how to turn it off.

    code: names of the mechanism's functions and classes in `estimators.core`, then the number of its other code lines
    disturbances, discrepancy, settings: changed fields of the filter's arguments of these names
    knows_constants: whether the filter considers the uncertainty of constants
    patches: replacements of attributes in `estimators.core`, if no argument turns the mechanism off
    """

    code: str
    disturbances: Fields = field(default_factory=dict)
    discrepancy: Fields = field(default_factory=dict)
    settings: Fields = field(default_factory=dict)
    knows_constants: bool = True
    patches: Fields = field(default_factory=dict)

    @property
    def lines(self) -> int:
        """Number of lines of the mechanism's code."""
        return sum(int(part) if part.isdecimal() else _length(part) for part in self.code.split())

    def filter(self, given: Recording) -> TissueFilter:
        """A filter for the recording, with the mechanism turned off. Use it only in the context `patched`."""
        settings = replace(given.settings, **self.settings)
        return TissueFilter(
            given.network,
            given.targets[0],
            given.marked,
            settings,
            uncertainty=given.uncertainty if self.knows_constants else None,
            disturbances=replace(Disturbances.of(settings), **self.disturbances),
            discrepancy=replace(Discrepancy.of(settings), **self.discrepancy),
        )

    def patched(self) -> ExitStack:
        """Context in which `patches` replace attributes of `estimators.core`."""
        stack = ExitStack()
        for place, value in self.patches.items():
            stack.enter_context(patch(f"estimators.core.{place}", value))
        return stack


def _length(name: str) -> int:
    """Number of lines of a function, class or method of this name in `estimators.core`."""
    module, *rest = name.split(".")
    found: Any = import_module(f"estimators.core.{module}")
    for part in rest:
        found = getattr(found, part)
    return len(inspect.getsource(getattr(found, "py_func", found)).splitlines())


MOVE = HypothesisFilter._move

LEVELS = (
    "discrepancy.LevelPosterior discrepancy.WithheldGroups kernels.withheld_log_likelihoods"
    " filter.HypothesisFilter._weigh_levels"
)

SWITCHES: Mapping[str, Switch] = {
    WHOLE: Switch(""),
    "slow forces": Switch(
        "motion.network.NetworkMotion._may_be_pushed 22", disturbances={"slow_m_s2": FORCES.slow_m_s2[:1]}
    ),
    "pokes": Switch(
        "8",
        disturbances={
            "poke_m_s2": FORCES.calm_m_s2,
            "bent": FORCES.bent * FORCES.calm_m_s2 / FORCES.poke_m_s2,  # other strengths still rise for stiff bodies
        },
    ),
    "led mode": Switch("14", disturbances={"led_m_s2": FORCES.poke_m_s2}),
    "strengths raised for stiff bodies": Switch(
        "disturbances.Disturbances.raised motion.network._slowest 5", disturbances={"bent": 0.0}
    ),
    "observed onset rates": Switch("20", patches={"filter.ONSET_SHAPE": 1e12}),
    "discrepancy": Switch(f"{LEVELS} discrepancy.Discrepancy 28", discrepancy={"levels": (0.0,)}),
    "smooth discrepancy": Switch(
        "4",
        discrepancy={
            "levels": tuple(FIELD.short * level for level in FIELD.levels),
            "short": 0.0,
            "lengths": FIELD.lengths[1:] * 2,
        },
    ),
    "short discrepancy": Switch("4", discrepancy={"short": 0.0}),
    "levels chosen by marks": Switch(f"{LEVELS} 14", discrepancy={"levels": FIELD.levels[1:2]}),
    "noise of marks": Switch("17", discrepancy={"noises": FIELD.noises[:1]}),
    "outliers": Switch("innovations.Outliers kernels.without_outliers 21", settings={"outlier_odds": 1e-300}),
    "second linearisation": Switch(
        "filter.HypothesisFilter._fitted tissue.TissueProcess.moved 20", patches={"tissue.TOLERANCE": np.inf}
    ),
    "linearisation error as noise": Switch(
        "6", patches={"filter.HypothesisFilter._move": lambda own, start, at, cov=None, **_: MOVE(own, start, at, cov)}
    ),
    "start under forces": Switch("tissue.TissueProcess._prior_of_motion 6", patches={"tissue.DISPLACED": 0.0}),
    "considered constants": Switch(
        "motion.network.NetworkMotion._moved_by_constants motion.network.NetworkMotion._accelerations 20",
        knows_constants=False,
    ),
}
"""Switches by name of the mechanism; the first leaves all mechanisms on."""
