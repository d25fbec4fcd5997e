"""Checksum of a message's body: CRC-64 of ECMA-182, most significant bit first, initially 0, without final XOR."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

POLYNOMIAL = 0x42F0E1EBA9EA3693
"""Polynomial of ECMA-182, annex B, without its leading term."""
BLOCK = 256
"""Number of bytes that are looked up at once; the table then has half a megabyte."""


def _table() -> NDArray[np.uint64]:
    """Contribution of a byte to the checksum, by the number of bytes that follow it and by its value, (BLOCK, 256)."""
    last = np.arange(256, dtype=np.uint64) << np.uint64(56)
    for _bit in range(8):
        last = (last << np.uint64(1)) ^ np.where(last >> np.uint64(63), np.uint64(POLYNOMIAL), np.uint64(0))
    rows = [last]
    for _byte in range(BLOCK - 1):
        rows.append((rows[-1] << np.uint64(8)) ^ last[rows[-1] >> np.uint64(56)])
    return np.stack(rows)


_TABLE = _table()
_AFTER = np.arange(BLOCK - 1, -1, -1)
_FIRST_EIGHT = [row.tolist() for row in _TABLE[: BLOCK - 9 : -1]]
"""Contributions of the first eight bytes of a block, to which the checksum so far is added."""


def crc64(body: bytes) -> int:
    """The checksum of these bytes; blocks are padded with leading zeros, which do not change it."""
    blocks = np.frombuffer(bytes(-len(body) % BLOCK) + body, dtype=np.uint8).reshape(-1, BLOCK)
    crc = 0
    for block in np.bitwise_xor.reduce(_TABLE[_AFTER, blocks], axis=1).tolist():
        if crc:
            for found, byte in zip(_FIRST_EIGHT, crc.to_bytes(8, "big"), strict=True):
                block ^= found[byte]  # noqa: PLW2901
        crc = block
    return crc
