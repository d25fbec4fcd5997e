"""Reference marks: pose error of a camera or tracker, and marks corrected by it.

What may enter: another motion.
"""

from estimators.pose.pose_filter import CameraMove, PoseEstimate, PoseFilter
from estimators.pose.rigid import RigidMotion
from estimators.pose.settings import PoseSettings

__all__ = ["CameraMove", "PoseEstimate", "PoseFilter", "PoseSettings", "RigidMotion"]
