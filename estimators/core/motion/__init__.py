"""Motion of a network of springs or of a continuum under unknown forces, linearised over a time step.

A new kind of motion belongs here.
"""

from estimators.core.motion.continuum import ContinuumMotion
from estimators.core.motion.model import SOURCES, Along, Motion
from estimators.core.motion.network import NetworkMotion
from estimators.core.motion.sigma_points import by_sigma_points

__all__ = ["SOURCES", "Along", "ContinuumMotion", "Motion", "NetworkMotion", "by_sigma_points"]
