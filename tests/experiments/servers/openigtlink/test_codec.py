"""Headers, extended headers and metadata, against published messages and against pyigtl."""

import struct

import numpy as np
import pytest
from pyigtl.messages import CRC64, MessageBase, StringMessage

from experiments.servers.openigtlink.bodies import pack_string
from experiments.servers.openigtlink.codec import (
    BLOCK,
    HEADER,
    LARGEST_BODY,
    MalformedError,
    Message,
    crc64,
    decode,
    decode_header,
    encode,
)
from tests.experiments.servers.openigtlink import published

METADATA = {"First patient age": "22", "Second patient age": "25"}


def taken_apart(found: bytes) -> Message:
    """The message in these bytes."""
    return decode(decode_header(found[: HEADER.size]), found[HEADER.size :])


def sealed(found: bytes) -> bytes:
    """A message with the size and checksum of the body that it has."""
    body = found[HEADER.size :]
    return found[:42] + struct.pack(">QQ", len(body), crc64(body)) + body


@pytest.mark.parametrize("found", [published.TRANSFORM, published.STATUS], ids=["TRANSFORM", "STATUS"])
def test_a_published_message_of_version_1_is_read(found: bytes):
    message = taken_apart(found)
    assert (message.device, message.utc_s) == ("DeviceName", published.TICKS / 2**32)
    assert (message.content, message.metadata, message.number) == (found[58:], {}, 0)


def test_a_published_message_with_metadata_is_read_and_written_byte_for_byte():
    message = taken_apart(published.TRANSFORM_WITH_METADATA)
    assert message.metadata == METADATA
    assert message.number == 1
    assert message.content == published.TRANSFORM[58:]
    assert encode(message) == published.TRANSFORM_WITH_METADATA


def test_a_time_is_read_by_pyigtl_to_its_rounding():
    """It rounds each of 32 halvings of a second to whole nanoseconds, and a float of today resolves 0.24 µs."""
    found = encode(Message("STRING", "a", pack_string(""), 1234567890.123456))
    assert MessageBase.parse_header(found[:58])["timestamp"] == pytest.approx(1234567890.123456, abs=3e-7, rel=0)
    assert struct.unpack(">Q", found[34:42])[0] / 2**32 == pytest.approx(1234567890.123456, abs=3e-10, rel=0)


def test_text_beyond_ascii_says_so():
    """MIBenum 106 is UTF-8; pyigtl cannot write it and reads it."""
    found = encode(Message("STRING", "a", pack_string(""), metadata={"who": "Grüße"}))
    assert struct.unpack(">HHHI", found[74:84]) == (1, 3, 106, 7)
    theirs = StringMessage()
    theirs.unpack(MessageBase.parse_header(found[:58]), found[58:])
    assert theirs.metadata == {"who": "Grüße"}
    assert taken_apart(found).metadata == {"who": "Grüße"}


@pytest.mark.parametrize(
    "made",
    [
        lambda: Message("TRANSFORM", "N" * 21, b""),
        lambda: Message("T" * 13, "N", b""),
        lambda: Message("TRANSFORM", "N", b"", -1.0),
        lambda: Message("TRANSFORM", "N", b"", float("nan")),
        lambda: Message("TRANSFORM", "N", b"", 2.0**32),
    ],
)
def test_what_a_header_has_no_room_for_is_refused(made):
    with pytest.raises(ValueError, match="expected"):
        made()


@pytest.mark.parametrize(
    "message",
    [Message("T" * 12, "N" * 20, b""), Message("IMAGE", "N", bytes(LARGEST_BODY - 14))],
    ids=["names of full length", "the largest body, with extended header and the size of the index"],
)
def test_the_longest_messages_are_read(message: Message):
    assert taken_apart(encode(message)) == message


def test_metadata_in_another_character_set_is_left_out():
    """MIBenum 4, ISO 8859-1, in place of ASCII for the first of two."""
    found = published.TRANSFORM_WITH_METADATA
    assert taken_apart(sealed(found[:122] + b"\0\4" + found[124:])).metadata == {"Second patient age": "25"}


def with_bytes(found: bytes, at: int, changed: bytes) -> bytes:
    """A message with other bytes at this place."""
    return found[:at] + changed + found[at + len(changed) :]


SIZES = [
    (58, struct.pack(">HHII", 11, 18, 39, 1)),
    (58, struct.pack(">HHII", 12, 65535, 39, 1)),
    (58, struct.pack(">HHII", 12, 18, 2**32 - 1, 1)),
    (58, struct.pack(">HHII", 12, 1, 39, 1)),
    (118, struct.pack(">H", 65535)),
    (120, struct.pack(">HHI", 65535, 3, 2)),
    (120, struct.pack(">HHI", 17, 3, 2**32 - 1)),
    (136, b"\xff"),
]
BROKEN = [
    (published.TRANSFORM[:57], "58 bytes"),
    (sealed(published.TRANSFORM_WITH_METADATA[:69]), "extended header"),
    *[(with_bytes(published.TRANSFORM, at, bytes([published.TRANSFORM[at] ^ 1])), "checksum") for at in (58, 80, 105)],
    *[(sealed(with_bytes(published.TRANSFORM_WITH_METADATA, at, fields)), "expected") for at, fields in SIZES],
    # P and O of a browser's POST
    *[(with_bytes(published.TRANSFORM, 0, struct.pack(">H", n)), "version") for n in (0, 3, 0x504F)],
    *[(with_bytes(published.TRANSFORM, at, b"\xff"), "UTF-8") for at in (2, 14)],
    *[
        (with_bytes(published.TRANSFORM, 42, struct.pack(">Q", n)), "at most 65536")
        for n in (LARGEST_BODY + 1, 2**64 - 1)
    ],
]


@pytest.mark.parametrize(("found", "said"), BROKEN, ids=[f"{k}-{said}" for k, (_, said) in enumerate(BROKEN)])
def test_what_is_no_message_is_refused(found: bytes, said: str):
    with pytest.raises(MalformedError, match=said):
        taken_apart(found)


@pytest.mark.parametrize("size", [0, 1, 8, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK, 2 * BLOCK + 9, 65536])
def test_the_checksum_of_any_length_is_that_of_pyigtl(size: int):
    body = np.random.default_rng(size).bytes(size)
    assert crc64(body) == CRC64(body)
