"""CDR, the encoding of ROS 2 messages: plain, little-endian, version 1 [corba], [ddsi-rtps]."""

from __future__ import annotations

import struct
from collections.abc import Sequence

HEADER = b"\x00\x01\x00\x00"
"""Header of plain CDR in little-endian order without options."""


class Cdr:
    """A message, field by field in the order of its definition.

    State: the bytes so far. After the header each number is aligned to its own size.
    """

    def __init__(self) -> None:
        self._bytes = bytearray(HEADER)

    def content(self) -> bytes:
        """The message so far."""
        return bytes(self._bytes)

    def int32(self, value: int) -> Cdr:
        """A signed integer."""
        return self._put("i", 4, [value])

    def uint32(self, value: int) -> Cdr:
        """An unsigned integer, or a length."""
        return self._put("I", 4, [value])

    def doubles(self, values: Sequence[float]) -> Cdr:
        """Consecutive numbers: several fields, or an array of fixed length, whose length CDR does not write."""
        return self._put("d", 8, values)

    def text(self, value: str) -> Cdr:
        """The length of a UTF-8 text with a zero byte, then both."""
        encoded = value.encode("utf-8") + b"\x00"
        self.uint32(len(encoded))
        self._bytes += encoded
        return self

    def octets(self, value: bytes) -> Cdr:
        """The length of a sequence of bytes, then the bytes."""
        self.uint32(len(value))
        self._bytes += value
        return self

    def _put(self, code: str, size: int, values: Sequence[float]) -> Cdr:
        self._bytes += bytes(-(len(self._bytes) - len(HEADER)) % size)
        self._bytes += struct.pack(f"<{len(values)}{code}", *values)
        return self
