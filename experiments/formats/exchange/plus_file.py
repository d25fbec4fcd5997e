"""Sequence files of PLUS, `.igs.mha`: MetaImage files. The fields of all frames come first, then all pixels.

The fields are defined in [plus], "Sequence file"; [igsio] has the code with which PLUS reads them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import BinaryIO

import numpy as np

from experiments.arrays import Floats
from vision.arrays import Image

WHOLE_READ_BYTES = 2**32
"""If all pixels together have this number of bytes or more, PLUS reads wrong frames: it counts bytes in 32 bits."""

_FIXED = {
    "BinaryData": "True",
    "BinaryDataByteOrderMSB": "False",
    "CompressedData": "False",
    "TransformMatrix": "1 0 0 0 1 0 0 0 1",
    "Offset": "0 0 0",
    "CenterOfRotation": "0 0 0",
    "AnatomicalOrientation": "RAI",
    "ElementSpacing": "1 1 1",
    "ElementType": "MET_UCHAR",
    "Kinds": "domain domain list",
    "UltrasoundImageOrientation": "MF",
}
"""Fields with fixed values. MF is the orientation of pictures with u right and v down; PLUS does not flip them."""


def write_plus(
    stream: BinaryIO,
    frames: Iterable[Mapping[str, str]],
    images: Iterable[Image] | None,
    *,
    n_frames: int,
    size_px: tuple[int, int],
) -> None:
    """Write a sequence, frame by frame.

    frames: the fields of each frame by name; frame number and picture fields are added
    images: one for each frame, (height, width, 3) BGR. If None, each frame is one pixel with the status INVALID
    size_px: width and height of the images
    """
    width, height = (1, 1) if images is None else size_px
    head = {"ObjectType": "Image", "NDims": "3", **_FIXED, "DimSize": f"{width} {height} {n_frames}"}
    head["ElementNumberOfChannels"] = "1" if images is None else "3"
    head["UltrasoundImageType"] = "BRIGHTNESS" if images is None else "RGB_COLOR"
    _write(stream, head)
    status = "INVALID" if images is None else "OK"
    for k, fields in enumerate(frames):
        own = {"FrameNumber": str(k), **fields, "ImageStatus": status}
        _write(stream, {f"Seq_Frame{k:04d}_{name}": value for name, value in own.items()})
    _write(stream, {"ElementDataFile": "LOCAL"})
    if images is None:
        stream.write(bytes(n_frames))
    else:
        for image in images:
            stream.write(np.ascontiguousarray(image[:, :, ::-1]).data)


def transform_fields(name: str, matrix: Floats | None) -> dict[str, str]:
    """Fields of a transform such as `TargetToReference`. `matrix`, (4, 4), is in mm; None for an invalid transform."""
    values = np.eye(4) if matrix is None else matrix
    text = " ".join(f"{value:.9g}" for value in values.ravel())
    return {f"{name}Transform": text, f"{name}TransformStatus": "INVALID" if matrix is None else "OK"}


def _write(stream: BinaryIO, fields: Mapping[str, str]) -> None:
    stream.write("".join(f"{name} = {value}\n" for name, value in fields.items()).encode("utf-8"))
