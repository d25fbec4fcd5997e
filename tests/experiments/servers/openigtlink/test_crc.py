"""The checksum, against crcmod, the checksum of pyigtl, and against that of a published message."""

import numpy as np
import pytest
from pyigtl.messages import CRC64

from experiments.servers.openigtlink.crc import BLOCK, crc64
from tests.experiments.servers.openigtlink import published


def test_the_check_value_of_the_catalogue():
    """CRC-64/ECMA-182 of the digits 1 to 9."""
    assert crc64(b"123456789") == 0x6C40DF5F0B497347


@pytest.mark.parametrize("size", [0, 1, 8, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK, 2 * BLOCK + 9, 65536])
def test_any_length_gives_the_same_as_another_implementation(size: int):
    body = np.random.default_rng(size).bytes(size)
    assert crc64(body) == CRC64(body)


def test_a_published_body_has_its_published_checksum():
    """Of POLYDATA, 300 bytes, longer than a block; bytes 50 to 58 of its header."""
    assert crc64(published.POLYDATA[58:]) == int.from_bytes(published.POLYDATA[50:58], "big")
