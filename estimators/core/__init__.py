"""The filter for any process model: Gaussian hypotheses, iterated update.

A new process model or observation belongs here.
"""

from estimators.core.ahead import AheadTables
from estimators.core.discrepancy import Discrepancy, LevelPosterior
from estimators.core.disturbances import Disturbances
from estimators.core.filter import HypothesisFilter
from estimators.core.marks import Places
from estimators.core.protocols import Observation, ProcessModel, Transition
from estimators.core.tissue import TissueProcess
from estimators.core.track import TissueFilter

__all__ = [
    "AheadTables",
    "Discrepancy",
    "Disturbances",
    "HypothesisFilter",
    "LevelPosterior",
    "Observation",
    "Places",
    "ProcessModel",
    "TissueFilter",
    "TissueProcess",
    "Transition",
]
