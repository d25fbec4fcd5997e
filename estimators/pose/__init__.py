"""Reference marks: the pose error of a camera or tracker from marks that do not move, and marks corrected by it.

What may enter: another motion of what sees the marks. It knows neither springs nor pictures.
"""

from estimators.pose.pose_filter import CameraMove, PoseEstimate, PoseFilter
from estimators.pose.rigid import RigidMotion
from estimators.pose.settings import PoseSettings

__all__ = ["CameraMove", "PoseEstimate", "PoseFilter", "PoseSettings", "RigidMotion"]
