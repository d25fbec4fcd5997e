"""Messages of OpenIGTLink and their bytes: header, extended header, content, metadata and checksum; all big-endian.

Input may be hostile: sizes are checked before use. Source: [openigtlink], header.md.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

HEADER = struct.Struct(">H12s20sQQQ")
EXTENDED = struct.Struct(">HHII")
INDEX, ENTRY = struct.Struct(">H"), struct.Struct(">HHI")
VERSIONS = (1, 2)
LONGEST_TYPE, LONGEST_NAME = 12, 20
LARGEST_BODY = 65536
"""Largest size of a received message's body [bytes]; a requirement."""
ASCII, UTF8 = 3, 106
"""Numbers of character sets: their MIBenum."""
TICKS = 2.0**32
"""Time stamp units per second: a stamp has 32 bits for seconds since 1970 UTC, and 32 bits for their fraction."""

POLYNOMIAL = 0x42F0E1EBA9EA3693
"""Polynomial of ECMA-182, annex B, without its leading term."""
BLOCK = 256
"""Number of bytes in a block, whose contributions are looked up together; the table of contributions has 0.5 MB."""


class MalformedError(ValueError):
    """Error for bytes that are not a message of OpenIGTLink, or for a message that is too long."""


@dataclass(frozen=True, slots=True)
class Message:
    """A message, with its content as bytes. Raises ValueError for values that the header cannot hold.

    utc_s: seconds since 1970 UTC, 0 for none
    metadata: texts by key; number: the message's identifier; both need version 2 of the protocol
    """

    type: str
    device: str
    content: bytes
    utc_s: float = 0.0
    metadata: Mapping[str, str] = field(default_factory=dict)
    number: int = 0

    def __post_init__(self) -> None:
        for name, text, longest in (("type", self.type, LONGEST_TYPE), ("device", self.device, LONGEST_NAME)):
            if len(text.encode()) > longest:
                raise ValueError(f"{name}: expected at most {longest} bytes, found {text!r}")
        if not 0.0 <= self.utc_s < TICKS:
            raise ValueError(f"utc_s: expected from 0 to below 2^32, found {self.utc_s}")


@dataclass(frozen=True, slots=True)
class Header:
    """The first 58 bytes of a message, with the size of its body [bytes]."""

    version: int
    type: str
    device: str
    utc_s: float
    size: int
    crc: int


def encode(message: Message) -> bytes:
    """The bytes of a message in version 2: header, extended header, content, index of the metadata, metadata."""
    index, texts = INDEX.pack(len(message.metadata)), b""
    for key, value in message.metadata.items():
        text = value.encode()
        index += ENTRY.pack(len(key.encode()), ASCII if value.isascii() else UTF8, len(text))
        texts += key.encode() + text
    extended = EXTENDED.pack(EXTENDED.size, len(index), len(texts), message.number)
    body = extended + message.content + index + texts
    kind, device, ticks = message.type.encode(), message.device.encode(), int(message.utc_s * TICKS)
    return HEADER.pack(2, kind, device, ticks, len(body), crc64(body)) + body


def decode_header(found: bytes) -> Header:
    """Decode the header, the first 58 bytes of a message. MalformedError if it is invalid or the body is too large."""
    if len(found) != HEADER.size:
        raise MalformedError(f"header: expected {HEADER.size} bytes, found {len(found)}")
    version, kind, device, ticks, size, crc = HEADER.unpack(found)
    if version not in VERSIONS:
        raise MalformedError(f"header version: expected 1 or 2, found {version}")
    if size > LARGEST_BODY:
        raise MalformedError(f"body: expected at most {LARGEST_BODY} bytes, found {size}")
    return Header(version, padded_text(kind), padded_text(device), ticks / TICKS, size, crc)


def decode(header: Header, body: bytes) -> Message:
    """The message with this header and body; MalformedError if size, checksum or metadata of the body are wrong."""
    if len(body) != header.size:
        raise MalformedError(f"body: expected {header.size} bytes, found {len(body)}")
    if crc64(body) != header.crc:
        raise MalformedError("checksum: expected that of the body, found another")
    if header.version == 1:
        return Message(header.type, header.device, body, header.utc_s)
    if len(body) < EXTENDED.size:
        raise MalformedError(f"extended header: expected {EXTENDED.size} bytes, found {len(body)}")
    own, index, texts, number = EXTENDED.unpack_from(body)
    end = len(body) - index - texts
    if own < EXTENDED.size or end < own:
        raise MalformedError("extended header: expected sizes that fit the body, found others")
    metadata = _metadata(body[end : end + index], body[end + index :])
    return Message(header.type, header.device, body[own:end], header.utc_s, metadata, number)


def _metadata(index: bytes, texts: bytes) -> dict[str, str]:
    """Keys and values of metadata; values in character sets other than ASCII and UTF-8 are omitted with their keys."""
    if not index and not texts:
        return {}
    count = INDEX.unpack_from(index)[0] if len(index) >= INDEX.size else -1
    if len(index) != INDEX.size + count * ENTRY.size:
        raise MalformedError("metadata: expected an index of its size, found another")
    entries = [ENTRY.unpack_from(index, INDEX.size + i * ENTRY.size) for i in range(count)]
    if sum(key + value for key, _set, value in entries) != len(texts):
        raise MalformedError("metadata: expected texts of the sizes in the index, found others")
    found: dict[str, str] = {}
    at = 0
    for key, encoding, value in entries:
        middle, end = at + key, at + key + value
        if encoding in (ASCII, UTF8):
            found[utf8(texts[at:middle])] = utf8(texts[middle:end])
        at = end
    return found


def padded_text(field_bytes: bytes) -> str:
    """The text of a zero-padded field; MalformedError if it is invalid."""
    return utf8(field_bytes.partition(b"\0")[0])


def utf8(text: bytes) -> str:
    """Bytes as text; MalformedError if they are invalid."""
    try:
        return text.decode()
    except UnicodeDecodeError as error:
        raise MalformedError(f"text: expected UTF-8, found byte 0x{text[error.start]:02x}") from None


def _table() -> NDArray[np.uint64]:
    """Contributions of a byte to the checksum, (BLOCK, 256); row: number of bytes after the byte; column: its value."""
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
"""Contributions of a block's first eight bytes. The checksum so far is added to these bytes before their look-up."""


def crc64(body: bytes) -> int:
    """The checksum of a body: CRC-64 of ECMA-182, most significant bit first, initial value 0, without final XOR.

    Leading zeros fill up the first block; they do not change the checksum.
    """
    blocks = np.frombuffer(bytes(-len(body) % BLOCK) + body, dtype=np.uint8).reshape(-1, BLOCK)
    crc = 0
    for block in np.bitwise_xor.reduce(_TABLE[_AFTER, blocks], axis=1).tolist():
        if crc:
            for found, byte in zip(_FIRST_EIGHT, crc.to_bytes(8, "big"), strict=True):
                block ^= found[byte]  # noqa: PLW2901
        crc = block
    return crc
