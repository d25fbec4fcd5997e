"""Contents of messages that a live run sends and receives; lengths in mm. Source: [openigtlink], by message type."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.arrays import Floats
from experiments.servers.openigtlink.codec import ASCII, UTF8, MalformedError, padded_text

MATRIX = struct.Struct(">12f")
STATUS = struct.Struct(">Hq20s")
STRING = struct.Struct(">HH")
POINT = struct.Struct(">64s32s4B3ff20s")
POLYDATA = struct.Struct(">10I")
LARGEST = float(np.finfo(np.float32).max)
"""Largest coordinate that a message can hold [mm]: messages have 32 bit floats."""


def pack_transform(matrix: Floats) -> bytes:
    """Content of TRANSFORM: the upper three rows of a (4, 4) matrix, column by column. ValueError above `LARGEST`."""
    if matrix.shape != (4, 4) or not (np.abs(matrix) <= LARGEST).all():
        raise ValueError(f"transform: expected finite 32 bit numbers of shape (4, 4), found {matrix.tolist()}")
    return MATRIX.pack(*matrix[:3].T.ravel())


def read_transform(content: bytes) -> Floats:
    """The (4, 4) matrix of a TRANSFORM, whose numbers are not checked; MalformedError for another size."""
    if len(content) != MATRIX.size:
        raise MalformedError(f"TRANSFORM: expected {MATRIX.size} bytes, found {len(content)}")
    matrix = np.eye(4)
    # by struct, because NumPy warns of a signalling NaN
    matrix[:3] = np.array(MATRIX.unpack(content)).reshape(4, 3).T
    return matrix


@dataclass(frozen=True, slots=True)
class StatusBody:
    """Content of STATUS: a code, where 1 means OK; an error name of at most 20 bytes; a text."""

    code: int
    name: str
    text: str


def pack_status(status: StatusBody) -> bytes:
    """Content of STATUS, with zero-terminated text. ValueError for a name of more than 20 bytes."""
    name = status.name.encode()
    if len(name) > 20:
        raise ValueError(f"status name: expected at most 20 bytes, found {status.name!r}")
    return STATUS.pack(status.code, 0, name) + status.text.encode() + b"\0"


def pack_string(text: str) -> bytes:
    """Content of STRING. ValueError for more than 65535 bytes."""
    found = text.encode()
    if len(found) > 0xFFFF:
        raise ValueError(f"string: expected at most 65535 bytes, found {len(found)}")
    return STRING.pack(ASCII if text.isascii() else UTF8, len(found)) + found


@dataclass(frozen=True, slots=True)
class PointBody:
    """One point of a POINT message: a fiducial."""

    name: str
    place_mm: tuple[float, float, float]
    group: str = ""
    rgba: tuple[int, int, int, int] = (255, 255, 0, 255)
    diameter_mm: float = 0.0
    owner: str = ""


def read_points(content: bytes) -> list[PointBody]:
    """The points of a POINT message; their numbers are not checked. MalformedError for an invalid message."""
    if len(content) % POINT.size:
        raise MalformedError(f"POINT: expected a multiple of {POINT.size} bytes, found {len(content)}")
    points = []
    for name, group, r, g, b, a, x, y, z, diameter, owner in POINT.iter_unpack(content):
        texts = padded_text(name), padded_text(group), padded_text(owner)
        points.append(PointBody(texts[0], (x, y, z), texts[1], (r, g, b, a), diameter, texts[2]))
    return points


def pack_surface(points_mm: Floats, polygons: Sequence[Sequence[int]]) -> bytes:
    """Content of POLYDATA: points, (n, 3), and polygons as lists of indices of points, without attributes."""
    cells: list[int] = []
    for polygon in polygons:
        cells += [len(polygon), *polygon]
    header = POLYDATA.pack(len(points_mm), 0, 0, 0, 0, len(polygons), 4 * len(cells), 0, 0, 0)
    return header + points_mm.astype(">f4").tobytes() + np.array(cells, dtype=">u4").tobytes()


def unit_sphere() -> tuple[Floats, list[list[int]]]:
    """Points on the sphere of radius 1 about the origin, (n, 3), and its triangles and quads, oriented outward."""
    n_around, n_rings = 24, 11  # points on a circle of latitude, and circles between the poles
    latitudes = np.pi * np.arange(1, n_rings + 1) / (n_rings + 1)
    around: NDArray[np.float64] = 2.0 * np.pi * np.arange(n_around) / n_around
    theta, phi = np.meshgrid(latitudes, around, indexing="ij")
    rings = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1).reshape(-1, 3)
    points = np.vstack([rings, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    north, south = len(rings), len(rings) + 1
    polygons: list[list[int]] = []
    for i in range(n_around):
        j = (i + 1) % n_around
        polygons.append([north, i, j])
        for ring in range(0, north - n_around, n_around):
            polygons.append([ring + i, ring + n_around + i, ring + n_around + j, ring + j])
        last = north - n_around
        polygons.append([south, last + j, last + i])
    return points, polygons
