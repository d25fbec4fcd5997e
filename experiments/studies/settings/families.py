"""The settings records of the project and the figures that each serves: what `sensitivity` varies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from estimators import FilterSettings, NeedleNoise, PlannedNeedle
from estimators.association import IdentitySettings
from experiments.pipeline.live.session import LiveSettings
from experiments.studies.estimation.figures import estimation_figures
from experiments.studies.marks import marks_figures
from experiments.studies.settings.body_figures import BodyConstants, body_figures
from experiments.studies.settings.calibration_figures import calibration_figures
from experiments.studies.settings.constants import Constants, constants_figures
from experiments.studies.settings.constants_of_prediction import PredictionConstants, prediction_figures
from experiments.studies.settings.guidance_figures import GuidanceSettings, guidance_figures
from experiments.studies.settings.identity_figures import identity_figures
from experiments.studies.settings.live_figures import live_figures
from experiments.studies.settings.needle_figures import needle_figures
from experiments.studies.settings.planning_figures import planning_figures
from experiments.studies.settings.source_figures import source_figures
from vision import CalibrationSettings, SourceSettings
from vision.tracking.settings import FINDER

Figures = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Family:
    """A settings record and the function that gives the figures it serves."""

    record: Any
    figures: Callable[[Any], Figures]


FAMILIES: dict[str, Family] = {
    "estimation": Family(FilterSettings(), estimation_figures),
    "constants of estimation": Family(Constants(), constants_figures),
    "stiff or large bodies": Family(BodyConstants(), body_figures),
    "constants of prediction": Family(PredictionConstants(), prediction_figures),
    "identity": Family(IdentitySettings(), identity_figures),
    "marks": Family(FINDER, marks_figures),
    "sources": Family(SourceSettings(), source_figures),
    "calibration": Family(CalibrationSettings(), calibration_figures),
    "guidance": Family(GuidanceSettings(), guidance_figures),
    "needle": Family(NeedleNoise(), needle_figures),
    "planning": Family(PlannedNeedle(), planning_figures),
    "live": Family(LiveSettings(), live_figures),
}
