"""`camera.toml`: a calibrated camera as a file, written whole and read back. Lengths in millimetres."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from experiments.arrays import Floats
from experiments.errors import InputError, shown
from experiments.formats.outputs import write_whole
from experiments.formats.toml_file import VERSION, Name, NotNegative, Positive, Row, Square, Strict, Three, read_toml
from vision import Calibration, Lens, Pose

TO_MM = np.array([1.0] * 12 + [1e3] * 3)
"""Takes a row of uncertainty in metres to that of the file."""


class CameraFile(Strict):
    """The whole of `camera.toml`, version 1."""

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


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedCamera:
    """A calibrated camera before a plane, as `camera.toml` has it.

    name, size_px: what it is called; width and height of its pictures [px]
    lens: matrix and distortion
    pose: world to camera [m]
    uncertainty: as in `Calibration`, (n, 15), in metres
    reprojection_rms_px: root mean square residual [px]
    mm_per_px: reach of a pixel on the plane at the picture's centre, across and down [mm]
    """

    name: str
    size_px: tuple[int, int]
    lens: Lens
    pose: Pose
    uncertainty: Floats
    reprojection_rms_px: float
    mm_per_px: tuple[float, float]


def checked_lens(matrix: Sequence[Sequence[float]], distortion: Sequence[float]) -> Lens:
    """The lens of a file; ValueError, `key: expected …, found …`."""
    A = np.array(matrix, dtype=float)
    if not (A[0, 0] > 0 and A[1, 1] > 0 and (A[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]] == [0, 0, 0, 0, 1]).all()):
        raise ValueError(f"matrix: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], found {shown(matrix)}")
    return Lens(A, np.array(distortion, dtype=float))


def checked_pose(rotation: Sequence[Sequence[float]], translation_mm: Sequence[float]) -> Pose:
    """The pose of a file; ValueError, `key: expected …, found …`."""
    R = np.array(rotation, dtype=float)
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0:
        raise ValueError(f"rotation: expected a rotation matrix, found {shown(rotation)}")
    return Pose(R, 1e-3 * np.array(translation_mm, dtype=float))


def write_camera_toml(calibration: Calibration, path: Path) -> None:
    """Write `camera.toml`, whole or not at all; raises InputError."""
    write_whole(path, camera_text(calibration))


def camera_text(calibration: Calibration) -> str:
    """A calibration as `camera.toml` has it."""
    c = calibration
    lines = [f"version = {VERSION}", f"name = {_text(c.name)}", f"size_px = [{c.size_px[0]}, {c.size_px[1]}]"]
    lines += ["", "# px; distortion k1 k2 p1 p2 k3; standard errors of fx fy cx cy and of the distortion"]
    lines += _rows("matrix", c.matrix)
    lines += [f"distortion = {_list(c.distortion)}", f"matrix_sd = {_list(c.matrix_sd)}"]
    lines += [f"distortion_sd = {_list(c.distortion_sd)}", f"reprojection_rms_px = {float(c.reprojection_rms_px)!r}"]
    lines += [f"reprojection_rms_px_each = {_list(c.rms_px_each)}"]
    lines += _names("images_used", c.images_used)
    lines += _names("images_left_out", c.images_left_out)
    lines += ["", "# world to camera: x right, y up, z toward the camera, to x right, y down, z forward"]
    lines += _rows("rotation", c.pose.rotation)
    lines += [f"translation_mm = {_list(1e3 * c.pose.translation_m)}", f"mm_per_px = {_list(c.mm_per_px)}"]
    lines += [f"plane_image = {_text(c.plane_image)}"]
    lines += [
        "",
        "# rows of one standard deviation: fx fy cx cy k1 k2 p1 p2 k3, rotation [rad] x y z, translation [mm]",
    ]
    lines += _rows("uncertainty", c.uncertainty * TO_MM)
    return "\n".join(lines) + "\n"


def read_camera_toml(path: Path) -> CalibratedCamera:
    """The camera of a file; raises InputError, `camera.toml: key: expected …, found …`, for the first fault."""
    file = read_toml(path, CameraFile)
    try:
        lens, pose = checked_lens(file.matrix, file.distortion), checked_pose(file.rotation, file.translation_mm)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    if len(file.reprojection_rms_px_each) != len(file.images_used):
        raise InputError.at(
            f"{path}: reprojection_rms_px_each",
            f"{len(file.images_used)} entries, one an image used",
            str(len(file.reprojection_rms_px_each)),
        )
    return CalibratedCamera(
        name=file.name,
        size_px=(file.size_px[0], file.size_px[1]),
        lens=lens,
        pose=pose,
        uncertainty=np.array(file.uncertainty) / TO_MM,
        reprojection_rms_px=file.reprojection_rms_px,
        mm_per_px=(file.mm_per_px[0], file.mm_per_px[1]),
    )


def _list(values: Iterable[float]) -> str:
    return f"[{', '.join(repr(float(value)) for value in values)}]"


def _rows(key: str, rows: Floats) -> list[str]:
    return [f"{key} = [", *(f"    {_list(row)}," for row in rows), "]"]


def _names(key: str, names: Iterable[str]) -> list[str]:
    return [f"{key} = [", *(f"    {_text(name)}," for name in names), "]"]


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)
