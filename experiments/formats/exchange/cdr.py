"""CDR, the encoding of ROS 2 messages: plain, little-endian, version 1 [corba], [ddsi-rtps]."""

from __future__ import annotations

import struct
from typing import Any

HEADER = b"\x00\x01\x00\x00"
"""Header of plain CDR in little-endian order without options."""


def encoded(form: str, *values: Any) -> bytes:
    """A message with these values; `form` has one letter for each value.

    i, I, d: a number as in `struct`, aligned to its size; s: text, which ends with a zero byte; b: bytes
    Text and bytes begin with their length. The entries of an array of fixed length are single values.
    """
    body = bytearray()
    for code, value in zip(form, values, strict=True):
        content = value.encode("utf-8") + b"\x00" if code == "s" else value
        kind, number = ("<I", len(content)) if code in "sb" else (f"<{code}", value)
        body += bytes(-len(body) % struct.calcsize(kind)) + struct.pack(kind, number)
        if code in "sb":
            body += content
    return HEADER + bytes(body)
