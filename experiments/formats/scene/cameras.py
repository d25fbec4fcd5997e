"""Cameras of a scene file: read from `[[camera]]` or the file that it names, and written to it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.errors import shown
from experiments.formats.camera_file import TO_MM, checked_lens, checked_pose, read_camera_toml
from experiments.formats.scene.schema import CameraTable
from vision import PlaneCamera, posed_camera

METRES_TO_MM = np.diag([1e3, 1e3, 1.0])
"""Takes points of the plane in metres, homogeneous, to the millimetres of a scene file's homography."""


def camera_of(table: CameraTable, folder: Path) -> PlaneCamera:
    """The camera of a table; a file that it names is searched in this folder.

    Raises ValueError, `key: expected …, found …`, and InputError for that file.
    """
    if table.file is not None:
        c = read_camera_toml(folder / table.file)
        seen = posed_camera(c.name, c.size_px, c.lens, c.pose, calibration=c.uncertainty)
        return replace(seen, calibration_sd_px=table.calibration_sd_px, scale_sd=table.scale_sd)
    assert table.name is not None
    assert table.size_px is not None
    size_px = (table.size_px[0], table.size_px[1])
    if table.plane_to_px is not None:
        homography = np.array(table.plane_to_px, dtype=float) @ METRES_TO_MM
        try:
            return PlaneCamera(table.name, size_px, homography, table.calibration_sd_px, scale_sd=table.scale_sd)
        except ValueError:  # all else that it checks, the file's model has checked
            raise ValueError(
                "plane_to_px: expected a matrix that can be inverted, with the plane in mid-picture,"
                f" found {shown(table.plane_to_px)}"
            ) from None
    assert table.matrix is not None
    assert table.distortion is not None
    assert table.rotation is not None
    assert table.translation_mm is not None
    lens, pose = checked_lens(table.matrix, table.distortion), checked_pose(table.rotation, table.translation_mm)
    calibration = np.reshape(table.uncertainty or [], (-1, 15)) / TO_MM
    try:
        seen = posed_camera(table.name, size_px, lens, pose, calibration=calibration)
    except ValueError:
        raise ValueError(
            f"translation_mm: expected a pose before the plane z = 0, found {shown(table.translation_mm)}"
        ) from None
    return replace(seen, calibration_sd_px=table.calibration_sd_px, scale_sd=table.scale_sd)


def camera_lines(camera: PlaneCamera) -> list[str]:
    """`[[camera]]` of a scene file, line by line."""
    lines = ["", "[[camera]]", f"name = {shown(camera.name)}", f"size_px = [{camera.size_px[0]}, {camera.size_px[1]}]"]
    if camera.lens is None:
        lines += _rows("plane_to_px", camera.plane_to_px @ np.linalg.inv(METRES_TO_MM))
    else:
        pose = camera.pose
        lines += _rows("matrix", camera.lens.matrix)
        lines += [f"distortion = {_list(camera.lens.distortion)}"]
        lines += [*_rows("rotation", pose.rotation), f"translation_mm = {_list(1e3 * pose.translation_m)}"]
        if len(camera.calibration):
            lines += _rows("uncertainty", camera.calibration * TO_MM)
    if camera.scale_sd is not None:
        lines += [f"scale_sd = {float(camera.scale_sd)!r}"]
    return [*lines, f"calibration_sd_px = {_list([camera.calibration_sd_px])[1:-1]}"]


def _list(values: Iterable[float]) -> str:
    return f"[{', '.join(repr(float(value)) for value in values)}]"


def _rows(key: str, rows: Iterable[Iterable[float]]) -> list[str]:
    return [f"{key} = [", *(f"    {_list(row)}," for row in rows), "]"]
