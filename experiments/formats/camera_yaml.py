"""Reading and writing of lenses in the YAML formats of OpenCV and ROS (`camera_info`)."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from experiments.arrays import Floats
from experiments.errors import InputError, read_text, shown
from vision import Lens, quiet_opencv

ROS_MODELS = ("plumb_bob", "rational_polynomial")

COEFFICIENTS = (4, 5, 8, 12, 14)
"""Permitted numbers of distortion coefficients. OpenCV's order is k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4, two tilts."""

N_DLT = 11
"""Number of coefficients of one camera in a direct linear transformation, L1 to L11."""

POSE = "rotation and translation_mm (softaim calibrate finds lens and pose)"
"""Keys of a scene's camera that state the pose of a lens."""


@dataclass(frozen=True, slots=True, eq=False)
class LensFile:
    """A lens without a pose, the size of its pictures [px], and the camera's name if the file states it."""

    lens: Lens
    size_px: tuple[int, int]
    name: str | None = None


def read_lens_file(path: Path) -> LensFile | None:
    """The lens in a file of OpenCV or ROS, recognised by its content; None for other formats.

    Raises InputError. For some camera files of other programs the message says what to do.
    """
    text = read_text(path)
    if re.match(r"\s*(%YAML:1\.0|<\?xml|<opencv_storage|\{)", text) or "!!opencv-matrix" in text:
        return read_opencv_yaml(path)
    if re.search(r"^(camera_matrix|image_width|distortion_model):", text, flags=re.MULTILINE):
        return read_ros_yaml(path)
    if re.search(r"^\s*(T_cam_imu|camera_model|distortion_coeffs|intrinsics):", text, flags=re.MULTILINE):
        own = "camera_matrix and distortion_coefficients in the form of ROS, from its intrinsics and distortion_coeffs"
        raise InputError.at(path, own, "a file of Kalibr")
    numbers = re.fullmatch(r"(?:\s*[-+]?[\d.]+(?:[eE][-+]?\d+)?\s*[,;]?)+\s*", text)
    if numbers is not None and len(re.split(r"[\s,;]+", text.strip())) % N_DLT == 0:
        view = "plane_to_px = [[L1, L2, L4], [L5, L6, L8], [L9, L10, 1]], for z = 0 in mm, with v down"
        raise InputError.at(path, view, "DLT coefficients")
    return None


def opencv_text(content: LensFile) -> str:
    """A lens in the format of cv2.FileStorage: image_width, image_height, camera_matrix and distortion_coefficients."""
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("image_width", content.size_px[0])
    storage.write("image_height", content.size_px[1])
    storage.write("camera_matrix", content.lens.matrix)
    storage.write("distortion_coefficients", content.lens.distortion.reshape(-1, 1))
    return str(storage.releaseAndGetString())


def read_opencv_yaml(path: Path) -> LensFile:
    """The lens in a file of cv2.FileStorage; raises InputError with file and key."""
    text = read_text(path)
    try:
        with quiet_opencv():
            storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except (cv2.error, SystemError):
        raise InputError.at(path, "YAML of OpenCV", "a file that OpenCV cannot read") from None
    size = [storage.getNode(key) for key in ("image_width", "image_height")]
    if storage.getNode("fisheye_model").isInt() and storage.getNode("fisheye_model").real():
        raise InputError.at(f"{path}: fisheye_model", "0; undistort pictures of a fisheye lens first", "1")
    for key, node in zip(("image_width", "image_height"), size, strict=True):
        if node.empty() or not node.isInt() or node.real() < 1:
            raise InputError.at(f"{path}: {key}", "a whole number of 1 or more", "none")
    arrays = {}
    for key in ("camera_matrix", "distortion_coefficients"):
        node = storage.getNode(key)
        try:
            found = None if node.empty() else node.mat()
        except cv2.error:
            found = None
        if found is None:
            raise InputError.at(f"{path}: {key}", "a matrix", "none")
        arrays[key] = np.asarray(found, dtype=np.float64)
    lens = _lens(path, arrays["camera_matrix"], arrays["distortion_coefficients"])
    return LensFile(lens, (int(size[0].real()), int(size[1].real())), path.stem)


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


def read_ros_yaml(path: Path) -> LensFile:
    """The lens in a camera_info file of ROS; raises InputError with file and key or line."""
    tables = _ros_tables(path)
    if (model := tables.get("distortion_model", "none")) not in ROS_MODELS:
        also = "rational_polynomial is also supported; undistort pictures of a fisheye lens first"
        raise InputError.at(f"{path}: distortion_model", ROS_MODELS[0], f"{shown(model)}; {also}")
    size = []
    for key in ("image_width", "image_height"):
        text = tables.get(key, "none")
        if not (isinstance(text, str) and re.fullmatch(r"[1-9][0-9]{0,8}", text)):
            raise InputError.at(f"{path}: {key}", "a whole number of 1 or more", shown(text))
        size.append(int(text))
    matrix, distortion = (_ros_matrix(path, tables, key) for key in ("camera_matrix", "distortion_coefficients"))
    name = tables.get("camera_name")
    return LensFile(_lens(path, matrix, distortion), (size[0], size[1]), name if isinstance(name, str) else None)


def _block(key: str, values: Floats) -> list[str]:
    data = ", ".join(repr(float(v)) for v in values.ravel())
    return [f"{key}:", f"  rows: {values.shape[0]}", f"  cols: {values.shape[1]}", f"  data: [{data}]"]


def _ros_tables(path: Path) -> Mapping[str, str | dict[str, str]]:
    """Keys and values of a camera_info file. Tables have at most two levels; lists may continue on further lines."""
    text = read_text(path)
    # join wrapped lists, and lists with one entry on each line
    text = re.sub(r"\[[^\]]*\]", lambda found: " ".join(found[0].split()), text)
    text = re.sub(r":[ \t]*((?:\n[ \t]*-[ \t]+[^\n]*)+)", lambda found: f": [{', '.join(_entries(found[1]))}]", text)
    tables: dict[str, str | dict[str, str]] = {}
    inside: dict[str, str] | None = None
    for number, raw in enumerate(text.splitlines(), start=1):
        line = re.sub(r"(^|\s)#.*$", "", raw).rstrip()
        if not line or line == "---" or line.startswith("%"):
            continue
        parts = re.fullmatch(r"(\s*)([A-Za-z_]\w*):(?:\s+(.*))?", line)
        if parts is None or (parts[1] and inside is None):
            raise InputError.at(f"{path}: line {number}", "key: value", shown(line.strip()))
        key, value = parts[2], _unquoted(parts[3] or "")
        if parts[1] and inside is not None:
            inside[key] = value
        elif value:
            tables[key], inside = value, None
        else:
            inside = {}
            tables[key] = inside
    return tables


def _entries(block: str) -> list[str]:
    return [line.split("-", 1)[1].strip() for line in block.strip().splitlines()]


def _unquoted(value: str) -> str:
    text = value.strip()
    return text[1:-1] if len(text) > 1 and text[0] == text[-1] and text[0] in "\"'" else text


def _ros_matrix(path: Path, tables: Mapping[str, str | dict[str, str]], key: str) -> Floats:
    table = tables.get(key)
    if not isinstance(table, dict):
        raise InputError.at(f"{path}: {key}", "rows, cols and data", "none" if table is None else shown(table))
    try:
        shape = (int(table["rows"]), int(table["cols"]))
        listed = table["data"]
        if not (listed.startswith("[") and listed.endswith("]")):
            raise ValueError(listed)
        values = np.array([float(v) for v in listed[1:-1].split(",")])
        return values.reshape(shape)
    except KeyError as missing:
        raise InputError.at(f"{path}: {key}.{missing.args[0]}", "this key", "none") from None
    except ValueError:
        raise InputError.at(
            f"{path}: {key}.data", "rows times cols numbers in brackets", shown(table.get("data"))
        ) from None


def _lens(path: Path, matrix: Floats, distortion: Floats) -> Lens:
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or not min(matrix[0, 0], matrix[1, 1]) > 0:
        raise InputError.at(f"{path}: camera_matrix", "3 rows of 3 numbers, focal lengths above 0", _reported(matrix))
    flat = distortion.ravel()
    if len(flat) not in COEFFICIENTS or not np.isfinite(flat).all():
        expected = f"{', '.join(map(str, COEFFICIENTS[:-1]))} or {COEFFICIENTS[-1]} numbers, k1 k2 p1 p2 [k3 …]"
        raise InputError.at(f"{path}: distortion_coefficients", expected, _reported(flat))
    if flat[12:].any():
        raise InputError.at(f"{path}: distortion_coefficients", "a sensor that is not tilted", _reported(flat[12:]))
    return Lens(matrix, np.append(flat[:12], np.zeros(max(0, 5 - len(flat)))))


def _reported(values: Floats | Sequence[float]) -> str:
    return shown(np.asarray(values).tolist())
