"""Cameras of a scene file: reading of `[[camera]]` or of the file that it names, and writing of `[[camera]]`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.arrays import Floats
from experiments.errors import placed, shown
from experiments.formats.camera_file import TO_MM, checked_lens, checked_pose, read_camera_toml
from experiments.formats.camera_yaml import LensFile, read_lens_file
from experiments.formats.scene.schema import CameraTable
from experiments.formats.toml_file import exactly, key_lines
from vision import PlaneCamera, SpaceCamera, posed_camera

METRES_TO_MM = np.diag([1e3, 1e3, 1.0])
"""Matrix that converts homogeneous points of the plane from metres to millimetres; files have homographies in mm."""


Camera = PlaneCamera | SpaceCamera | LensFile
"""A camera of a scene in the plane, a camera of a scene in space, or a lens without a pose."""


def camera_of(table: CameraTable, folder: Path, dim: int) -> Camera:
    """The camera of a table, or only its lens if the table states no pose.

    folder: folder of the camera file; dim: dimension of the scene
    Raises ValueError, `key: expected …, found …`, for faults of the table, and InputError for faults of the file.
    """
    if dim == 3:
        for key in ("plane_to_px", "scale_sd"):
            if getattr(table, key) is not None:
                raise ValueError(f"{key}: expected a flat scene, found a network in space; give matrix and pose")
    camera = _of_file(table, folder, dim) if table.file is not None else _of_keys(table, dim)
    if isinstance(camera, LensFile):
        return camera
    if isinstance(camera, SpaceCamera):
        return replace(camera, calibration_sd_px=table.calibration_sd_px)
    return replace(camera, calibration_sd_px=table.calibration_sd_px, scale_sd=table.scale_sd)


def _of_file(table: CameraTable, folder: Path, dim: int) -> Camera:
    path = folder / str(table.file)
    lens = read_lens_file(path)
    if lens is not None:
        return _placed(table, lens, dim)
    camera = read_camera_toml(path)
    if table.rotation is not None:
        raise ValueError(f"rotation: expected no such key beside {table.file}, which has the camera's pose, found one")
    with placed(path, ValueError):
        return _in(dim, camera)


def _of_keys(table: CameraTable, dim: int) -> Camera:
    assert table.name is not None
    assert table.size_px is not None
    size_px = (table.size_px[0], table.size_px[1])
    if table.matrix is not None:
        assert table.distortion is not None
        return _placed(table, LensFile(checked_lens(table.matrix, table.distortion), size_px, table.name), dim)
    homography = np.array(table.plane_to_px, dtype=float) @ METRES_TO_MM
    try:
        return PlaneCamera(table.name, size_px, homography)
    except ValueError:  # `CameraTable` has checked all other keys
        raise ValueError(
            "plane_to_px: expected a matrix that can be inverted, with the plane in mid-picture,"
            f" found {shown(table.plane_to_px)}"
        ) from None


def _placed(table: CameraTable, lens: LensFile, dim: int) -> Camera:
    """The camera with this lens and the table's pose. If the table has no pose, the result is the lens."""
    if table.rotation is None or table.translation_mm is None:
        return lens
    calibration = np.reshape(table.uncertainty or [], (-1, 15)) / TO_MM
    pose = checked_pose(table.rotation, table.translation_mm)
    return _in(dim, SpaceCamera(lens.name or "camera", lens.size_px, lens.lens, pose, calibration=calibration))


def _in(dim: int, camera: SpaceCamera) -> PlaneCamera | SpaceCamera:
    """The camera for a scene of this dimension: a `PlaneCamera` in the plane, the given camera in space."""
    if dim == 3:
        return camera
    try:
        return posed_camera(camera.name, camera.size_px, camera.lens, camera.pose, calibration=camera.calibration)
    except ValueError:
        found = shown(_translation_mm(camera).tolist())
        raise ValueError(f"translation_mm: expected a pose before the plane z = 0, found {found}") from None


def _translation_mm(camera: PlaneCamera | SpaceCamera) -> Floats:
    return np.round(1e3 * camera.pose.translation_m, 9)


def camera_lines(camera: Camera) -> list[str]:
    """Lines of `[[camera]]`."""
    keys: dict[str, Any] = {"name": camera.name or "camera", "size_px": camera.size_px}
    if camera.lens is None:
        keys["plane_to_px"] = camera.plane_to_px @ np.linalg.inv(METRES_TO_MM)
    else:
        keys |= {"matrix": camera.lens.matrix, "distortion": camera.lens.distortion}
    if not isinstance(camera, LensFile):
        if camera.lens is not None:
            keys |= {"rotation": camera.pose.rotation, "translation_mm": _translation_mm(camera)}
            keys["uncertainty"] = camera.calibration * TO_MM if len(camera.calibration) else None
        if isinstance(camera, PlaneCamera):
            keys["scale_sd"] = camera.scale_sd
        keys["calibration_sd_px"] = float(camera.calibration_sd_px)
    return ["", "[[camera]]", *key_lines(keys, exactly)]
