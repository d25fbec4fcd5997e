"""One filter for any process model and observation: hypotheses, one iterated update.

What may enter: another model or observation.
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
