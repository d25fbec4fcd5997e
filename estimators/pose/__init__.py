"""Pose error of a camera or tracker from reference marks, correction of marks, registration of a body.

A new model of pose motion belongs here.
"""

from estimators.pose.pose_filter import CameraMove, PoseEstimate, PoseFilter
from estimators.pose.registration import Registration, RegistrationError, register_points, weighted_mean, without_each
from estimators.pose.rigid import RigidMotion
from estimators.pose.settings import PoseSettings

__all__ = [
    "CameraMove",
    "PoseEstimate",
    "PoseFilter",
    "PoseSettings",
    "Registration",
    "RegistrationError",
    "RigidMotion",
    "register_points",
    "weighted_mean",
    "without_each",
]
