"""`camera.toml`: a calibrated camera as a file. Lengths in millimetres."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from experiments.errors import InputError, placed, shown
from experiments.formats.toml_file import (
    VERSION,
    Name,
    NotNegative,
    Positive,
    Row,
    Square,
    Strict,
    Three,
    exactly,
    key_lines,
    long_list,
    read_toml,
)
from vision import Calibration, Lens, Pose, SpaceCamera

TO_MM = np.array([1.0] * 12 + [1e3] * 3)
"""Factors on the entries of a row of `uncertainty`: the last three convert the translation from m to mm."""


class CameraFile(Strict):
    """The content of `camera.toml`, version 1."""

    version: int
    name: Name
    size_px: Annotated[list[Annotated[int, Field(gt=0)]], Field(min_length=2, max_length=2)]
    matrix: Square
    distortion: Annotated[list[float], Field(min_length=5, max_length=5)]
    matrix_sd: Annotated[list[NotNegative], Field(min_length=4, max_length=4)]
    distortion_sd: Annotated[list[NotNegative], Field(min_length=5, max_length=5)]
    reprojection_rms_px: NotNegative
    reprojection_rms_px_each: list[NotNegative]
    images_used: list[Name]
    images_left_out: list[Name]
    rotation: Square
    translation_mm: Three
    mm_per_px: Annotated[list[Positive], Field(min_length=2, max_length=2)]
    plane_image: Name
    uncertainty: Annotated[list[Row], Field(min_length=1)]


def checked_lens(matrix: Sequence[Sequence[float]], distortion: Sequence[float], key: str = "matrix") -> Lens:
    """The lens with this camera matrix and distortion; raises ValueError, `key: expected …, found …`, if invalid."""
    A = np.array(matrix, dtype=float)
    good = A.shape == (3, 3) and np.isfinite(A).all() and min(A[0, 0], A[1, 1]) > 0
    if not (good and (A[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]] == [0, 0, 0, 0, 1]).all()):
        raise ValueError(f"{key}: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], found {shown(matrix)}")
    return Lens(A, np.array(distortion, dtype=float))


def checked_pose(rotation: Sequence[Sequence[float]], translation_mm: Sequence[float]) -> Pose:
    """The pose with this rotation and translation [mm]; raises ValueError, `key: expected …, found …`, if invalid."""
    R = np.array(rotation, dtype=float)
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0:
        raise ValueError(f"rotation: expected a rotation matrix, found {shown(rotation)}")
    return Pose(R, 1e-3 * np.array(translation_mm, dtype=float))


def camera_text(calibration: Calibration) -> str:
    """A calibration as text of `camera.toml`."""
    c = calibration
    lens = {"matrix": c.matrix, "distortion": c.distortion, "matrix_sd": c.matrix_sd, "distortion_sd": c.distortion_sd}
    fit = {"reprojection_rms_px": float(c.reprojection_rms_px), "reprojection_rms_px_each": c.rms_px_each}
    pose = {"rotation": c.pose.rotation, "translation_mm": 1e3 * c.pose.translation_m}
    lines = [
        *key_lines({"version": VERSION, "name": c.name, "size_px": c.size_px}),
        "",
        "# px; distortion k1 k2 p1 p2 k3; standard errors of fx fy cx cy and of the distortion",
        *key_lines({**lens, **fit}, exactly),
        *long_list("images_used", c.images_used),
        *long_list("images_left_out", c.images_left_out),
        "",
        "# world to camera: x right, y up, z toward the camera, to x right, y down, z forward",
        *key_lines({**pose, "mm_per_px": c.mm_per_px, "plane_image": c.plane_image}, exactly),
        "",
        "# rows of one standard deviation: fx fy cx cy k1 k2 p1 p2 k3, rotation [rad] x y z, translation [mm]",
        *long_list("uncertainty", c.uncertainty * TO_MM, exactly),
    ]
    return "\n".join(lines) + "\n"


def read_camera_toml(path: Path) -> SpaceCamera:
    """The camera of a file; raises InputError, `camera.toml: key: expected …, found …`, for the first fault."""
    file = read_toml(path, CameraFile)
    with placed(path, ValueError):
        lens, pose = checked_lens(file.matrix, file.distortion), checked_pose(file.rotation, file.translation_mm)
    if len(file.reprojection_rms_px_each) != len(file.images_used):
        raise InputError.at(
            f"{path}: reprojection_rms_px_each",
            f"{len(file.images_used)} entries, one for each image used",
            str(len(file.reprojection_rms_px_each)),
        )
    size_px = file.size_px[0], file.size_px[1]
    return SpaceCamera(file.name, size_px, lens, pose, calibration=np.array(file.uncertainty) / TO_MM)
