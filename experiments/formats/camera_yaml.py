"""Reading and writing of lenses in the YAML formats of OpenCV and ROS (`camera_info`)."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from experiments.arrays import Floats
from experiments.errors import InputError, placed, read_text, shown
from experiments.formats.camera_file import checked_lens
from vision import Lens, quiet_opencv

ROS_MODELS = ("plumb_bob", "rational_polynomial")

COEFFICIENTS = (4, 5, 8, 12, 14)
"""Permitted numbers of distortion coefficients. OpenCV's order is k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y."""

MOST_PX = 10**9
"""Upper limit of a picture's width and height [px]; choice: OpenCV reads larger numbers wrongly."""

N_DLT = 11
"""Number of coefficients of one camera in a direct linear transformation, L1 to L11."""

POSE = "rotation and translation_mm (softaim calibrate finds lens and pose)"
"""Keys of a scene's camera that state the pose of a lens."""


@dataclass(frozen=True, slots=True, eq=False)
class LensFile:
    """A lens without a pose, the size of its pictures [px] and the camera's name; None if the file states no name."""

    lens: Lens
    size_px: tuple[int, int]
    name: str | None = None


def read_lens_file(path: Path) -> LensFile | None:
    """The lens in a file of OpenCV or ROS, recognised by its content; None for other formats.

    Raises InputError with file and key. For some camera files of other programs the message says what to do.
    """
    text = read_text(path)
    if re.match(r"\s*(%YAML:1\.0|<\?xml|<opencv_storage|\{)", text) or "!!opencv-matrix" in text:
        return _read(path, text, path.stem)
    if re.search(r"^(camera_matrix|image_width|distortion_model):", text, flags=re.MULTILINE):
        return replace(_read(path, _of_opencv(text), None), name=_ros_name(text))
    if re.search(r"^\s*(T_cam_imu|camera_model|distortion_coeffs|intrinsics):", text, flags=re.MULTILINE):
        own = "camera_matrix and distortion_coefficients in the form of ROS, from its intrinsics and distortion_coeffs"
        raise InputError.at(path, own, "a file of Kalibr")
    numbers = re.fullmatch(r"(?:\s*[-+]?[\d.]+(?:[eE][-+]?\d+)?\s*[,;]?)+\s*", text)
    if numbers is not None and len(re.split(r"[\s,;]+", text.strip())) % N_DLT == 0:
        view = "plane_to_px = [[L1, L2, L4], [L5, L6, L8], [L9, L10, 1]], for z = 0 in mm, with v down"
        raise InputError.at(path, view, "DLT coefficients")
    if path.suffix.lower() in (".yml", ".yaml"):
        raise InputError.at(path, "a camera of OpenCV or ROS", "neither" if text.strip() else "an empty file")
    return None


def opencv_text(content: LensFile) -> str:
    """A lens in the format of cv2.FileStorage: image_width, image_height, camera_matrix and distortion_coefficients."""
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("image_width", content.size_px[0])
    storage.write("image_height", content.size_px[1])
    storage.write("camera_matrix", content.lens.matrix)
    storage.write("distortion_coefficients", content.lens.distortion.reshape(-1, 1))
    return str(storage.releaseAndGetString())


def ros_text(content: LensFile) -> str:
    """A lens in the format of ROS's camera_info_manager: matrix and distortion, without rectification."""
    projection = np.column_stack([content.lens.matrix, np.zeros(3)])
    lines = [
        f"image_width: {content.size_px[0]}",
        f"image_height: {content.size_px[1]}",
        f"camera_name: {json.dumps(content.name or 'camera', ensure_ascii=False)}",
        *_block("camera_matrix", content.lens.matrix),
        f"distortion_model: {'plumb_bob' if len(content.lens.distortion) == 5 else 'rational_polynomial'}",
        *_block("distortion_coefficients", content.lens.distortion.reshape(1, -1)),
        *_block("rectification_matrix", np.eye(3)),
        *_block("projection_matrix", projection),
    ]
    return "\n".join(lines) + "\n"


def _block(key: str, values: Floats) -> list[str]:
    data = ", ".join(repr(float(v)) for v in values.ravel())
    return [f"{key}:", f"  rows: {values.shape[0]}", f"  cols: {values.shape[1]}", f"  data: [{data}]"]


def _of_opencv(text: str) -> str:
    """The text of a ROS file as YAML that OpenCV can read: without comments and camera name, with indented lists."""
    text = re.sub(r"(^|[ \t])#.*$|^(---|%).*$|^camera_name:.*$", "", text, flags=re.MULTILINE)
    return "%YAML:1.0\n" + re.sub(r"^([ \t]*)-[ \t]", r"\1    - ", text, flags=re.MULTILINE)


def _ros_name(text: str) -> str | None:
    """The camera's name in a file of ROS, even if the name is a number; None if there is no name."""
    form = r"""^camera_name:[ \t]*("[^"\n]*"|'[^'\n]*'|[^\s#"'](?:[^#\n]|(?<=\S)#)*)"""
    found = re.search(form, text, flags=re.MULTILINE)
    return None if found is None else found[1].strip().strip("\"'") or None


def _read(path: Path, text: str, name: str | None) -> LensFile:
    """The lens in a text that cv2.FileStorage reads.

    name: default name of the camera; None for a file of ROS, which must state the distortion model
    """
    try:
        with quiet_opencv():
            file = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except (cv2.error, SystemError) as error:
        fault = re.search(r"\((\d+)\): (.*)'", str(error.__cause__ or error.__context__ or error))
        if fault is None:
            raise InputError.at(path, "YAML of OpenCV or ROS", "a file that OpenCV cannot read") from None
        line = int(fault[1]) - (name is None)  # `_of_opencv` puts a line before a file of ROS
        raise InputError.at(f"{path}: line {line}", "YAML of OpenCV or ROS", fault[2]) from None
    fisheye, model, own_name = (file.getNode(key) for key in ("fisheye_model", "distortion_model", "camera_name"))
    if fisheye.isInt() and fisheye.real():
        raise InputError.at(f"{path}: fisheye_model", "0; undistort pictures of a fisheye lens first", "1")
    named = model.string() if model.isString() else "none"
    if (name is None or model.isString()) and named not in ROS_MODELS:
        also = "rational_polynomial is also supported; undistort pictures of a fisheye lens first"
        raise InputError.at(f"{path}: distortion_model", ROS_MODELS[0], f"{shown(named)}; {also}")
    size = []
    for key in ("image_width", "image_height"):
        node = file.getNode(key)
        if not node.isInt() or not 1 <= node.real() < MOST_PX:
            raise InputError.at(f"{path}: {key}", "a whole number of 1 or more", _found(node))
        size.append(int(node.real()))
    matrix, distortion = (
        _matrix(f"{path}: {key}", file.getNode(key)) for key in ("camera_matrix", "distortion_coefficients")
    )
    name = own_name.string() if own_name.isString() else name
    return LensFile(_lens(path, matrix, distortion), (size[0], size[1]), name)


def _matrix(place: str, node: Any) -> Floats:
    """The matrix in a node of cv2.FileStorage that has rows, cols and data."""
    if not node.isMap():
        raise InputError.at(place, "rows, cols and data", "none")
    for key in ("rows", "cols", "data"):
        if node.getNode(key).empty():
            raise InputError.at(f"{place}.{key}", "this key", "none")
    rows, cols, data = (node.getNode(key) for key in ("rows", "cols", "data"))
    entries = [data.at(k) for k in range(data.size())] if data.isSeq() else []
    other = [_found(entry) for entry in entries if not (entry.isInt() or entry.isReal())]
    is_shape = rows.isInt() and cols.isInt() and min(rows.real(), cols.real()) >= 0
    if other or not is_shape or len(entries) != rows.real() * cols.real():
        found = other[0] if other else f"{len(entries)} entries, {_found(rows)} rows and {_found(cols)} cols"
        raise InputError.at(f"{place}.data", "rows times cols numbers in brackets", found)
    return np.array([entry.real() for entry in entries]).reshape(int(rows.real()), int(cols.real()))


def _found(node: Any) -> str:
    if node.isString():
        return shown(node.string())
    return f"{node.real():.12g}" if node.isInt() or node.isReal() else "none"


def _lens(path: Path, matrix: Floats, distortion: Floats) -> Lens:
    flat = distortion.ravel()
    if len(flat) not in COEFFICIENTS or not np.isfinite(flat).all():
        expected = f"{', '.join(map(str, COEFFICIENTS[:-1]))} or {COEFFICIENTS[-1]} numbers, k1 k2 p1 p2 [k3 …]"
        raise InputError.at(f"{path}: distortion_coefficients", expected, shown(flat.tolist()))
    if flat[12:].any():
        raise InputError.at(
            f"{path}: distortion_coefficients", "a sensor that is not tilted", shown(flat[12:].tolist())
        )
    with placed(path, ValueError):
        return checked_lens(matrix.tolist(), [*flat[:12].tolist(), *[0.0] * (5 - len(flat))], "camera_matrix")
