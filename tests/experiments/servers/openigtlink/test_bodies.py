"""Contents of messages, against published ones and against pyigtl."""

import struct
from dataclasses import astuple
from itertools import pairwise

import numpy as np
import pytest
from pyigtl.messages import PointMessage, PolyDataMessage, StringMessage

from experiments.servers.openigtlink.bodies import (
    PointBody,
    StatusBody,
    pack_status,
    pack_string,
    pack_surface,
    pack_transform,
    read_points,
    read_transform,
    unit_sphere,
)
from experiments.servers.openigtlink.codec import MalformedError
from tests.experiments.servers.openigtlink import published

PUBLISHED_MATRIX = np.array(
    [
        [-0.954892, -0.196632, 0.222525, 46.0531],
        [0.196632, 0.142857, 0.970014, 19.4709],
        [-0.222525, 0.970014, -0.0977491, 46.0531],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
"""What the protocol's own test puts into the TRANSFORM."""


def test_the_published_transform():
    """Its numbers are the test's, rounded to 32 bits."""
    assert pack_transform(PUBLISHED_MATRIX) == published.TRANSFORM[58:]
    assert read_transform(published.TRANSFORM[58:]) == pytest.approx(PUBLISHED_MATRIX, rel=2**-24)


def test_a_transform_of_signalling_nan_is_read_without_a_warning():
    """Its quiet bit is not set: NumPy warns where it casts one."""
    assert np.isnan(read_transform(bytes.fromhex("7fa00000") * 12)[:3]).all()


def test_the_published_status():
    """All but its sub-code, bytes 2 to 10: ours is nought."""
    status, body = pack_status(StatusBody(15, "ACTUATOR_DISABLED", "Actuator A is disabled.")), published.STATUS[58:]
    assert (status[:2], status[2:10], status[10:]) == (body[:2], bytes(8), body[10:])


def test_strings_surfaces_and_points_are_those_of_pyigtl():
    assert pack_string("Welcome") == StringMessage("Welcome").pack()[58:]
    corners, faces = np.random.default_rng(0).normal(size=(5, 3)), [[0, 1, 2], [1, 2, 3, 4]]
    theirs = PolyDataMessage(points=corners, polygons=[3, 0, 1, 2, 4, 1, 2, 3, 4])
    assert pack_surface(corners, faces) == theirs.pack()[58:]
    points = [
        PointBody("one", (10.0, 15.0, 20.0), "Landmark", (255, 0, 0, 255), 5.0, "IMAGE_0"),
        PointBody("two", (25.0, 30.0, 35.0), "Landmark", (0, 255, 0, 128), 3.0, "IMAGE_0"),
    ]
    names, places, _, colours, diameters, _ = zip(*map(astuple, points), strict=True)
    theirs = PointMessage(list(places), list(names), list(colours), list(diameters), "Landmark", "IMAGE_0")
    assert read_points(theirs.pack()[58:]) == points
    assert read_points(b"") == []


def test_the_unit_sphere_is_one():
    """Points on the sphere, closed, seen from outside; its volume, of flat facets, is 4/3 pi less 3 %."""
    points, polygons = unit_sphere()
    assert np.linalg.norm(points, axis=1) == pytest.approx(1.0, abs=1e-12)
    edges = [edge for polygon in polygons for edge in pairwise([*polygon, polygon[0]])]
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)
    fans = [(p[0], p[i], p[i + 1]) for p in polygons for i in range(1, len(p) - 1)]
    volume = sum(np.linalg.det(points[list(fan)]) for fan in fans) / 6.0
    assert 0.97 * 4.0 / 3.0 * np.pi < volume < 4.0 / 3.0 * np.pi


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e39])
def test_a_transform_of_what_32_bits_cannot_hold_is_refused(bad: float):
    matrix = np.eye(4)
    matrix[0, 3] = bad
    with pytest.raises(ValueError, match="32 bit"):
        pack_transform(matrix)


def test_text_too_long_is_refused():
    assert len(pack_string("x" * 65535)) == 65539
    with pytest.raises(ValueError, match="65535"):
        pack_string("x" * 65536)
    with pytest.raises(ValueError, match="20 bytes"):
        pack_status(StatusBody(1, "x" * 21, ""))


def test_strings_of_utf8_say_so():
    assert pack_string("é") == struct.pack(">HH", 106, 2) + "é".encode()


@pytest.mark.parametrize(
    ("read", "content"),
    [
        (read_transform, bytes(47)),
        (read_transform, bytes(49)),
        (read_transform, b""),
        (read_points, bytes(135)),
        (read_points, bytes(137)),
        (read_points, b"\xff" + bytes(135)),
    ],
)
def test_contents_of_another_size_or_kind_are_refused(read, content: bytes):
    with pytest.raises(MalformedError):
        read(content)
