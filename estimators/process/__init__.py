"""Motion of a tissue under unknown and known forces, and the target's position.

Code for motion and process noise belongs here, code for marks does not.
"""

from estimators.process.known_force import ForceHistory, KnownForce
from estimators.process.open_loop_cov import OpenLoopCovariance
from estimators.process.process_model import FixBias, ForceMode, TissueModel, accumulated_noise
from estimators.process.target import TargetMap, TargetPoint, target_map

__all__ = [
    "FixBias",
    "ForceHistory",
    "ForceMode",
    "KnownForce",
    "OpenLoopCovariance",
    "TargetMap",
    "TargetPoint",
    "TissueModel",
    "accumulated_noise",
    "target_map",
]
