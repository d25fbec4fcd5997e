"""Cameras for plane and spatial scenes: lenses, poses, triangulation, calibration.

A new camera, lens or board belongs here.
"""

from vision.cameras.board import DICTIONARIES, Board, Corners, find_board
from vision.cameras.bundle import CalibrationError
from vision.cameras.calibration import Calibration, View, board_text, calibrate, rms
from vision.cameras.lens import Lens, Pose
from vision.cameras.plane_camera import PlaneCamera, fronto_parallel_camera, posed_camera
from vision.cameras.rig import CameraViews, calibrate_together
from vision.cameras.settings import CalibrationSettings
from vision.cameras.space_camera import SpaceCamera
from vision.cameras.triangulation import (
    Seen,
    Triangulated,
    calibration_steps,
    nearest_to_rays,
    plain_triangulation,
    principal_steps,
    triangulate,
    triangulated,
)

__all__ = [
    "DICTIONARIES",
    "Board",
    "Calibration",
    "CalibrationError",
    "CalibrationSettings",
    "CameraViews",
    "Corners",
    "Lens",
    "PlaneCamera",
    "Pose",
    "Seen",
    "SpaceCamera",
    "Triangulated",
    "View",
    "board_text",
    "calibrate",
    "calibrate_together",
    "calibration_steps",
    "find_board",
    "fronto_parallel_camera",
    "nearest_to_rays",
    "plain_triangulation",
    "posed_camera",
    "principal_steps",
    "rms",
    "triangulate",
    "triangulated",
]
