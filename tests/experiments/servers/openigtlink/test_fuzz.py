"""Mutated messages: the codec refuses what is none, and commands of the others are finite."""

import random
import struct
from collections import Counter

import numpy as np
from pyigtl.messages import PointMessage, PolyDataMessage

from experiments.servers.commands import read_command
from experiments.servers.openigtlink.bodies import pack_transform
from experiments.servers.openigtlink.codec import HEADER, MalformedError, Message, crc64, decode, decode_header, encode
from experiments.servers.openigtlink.incoming import Incoming, RefusedError
from tests.experiments.servers.openigtlink import published

OK = {"TransformStatus": "OK"}
WHOLE = [
    published.TRANSFORM_WITH_METADATA,
    published.STATUS,
    PolyDataMessage(points=np.eye(3), polygons=[3, 0, 1, 2]).pack(),
    encode(Message("TRANSFORM", "NeedleTipToReference", pack_transform(np.eye(4)), 1.8e9, OK)),
    encode(Message("POINT", "F", PointMessage([[1.0, 2.0, 3.0]]).pack()[58:])),
]


def mutated(rng: random.Random) -> bytes:
    """A message with something wrong with it; of half of them the size and the checksum are right all the same."""
    found = bytearray(rng.choice(WHOLE))
    at, kind = rng.randrange(len(found) - 3), rng.randrange(4)
    if kind == 0:
        found[at] = rng.randrange(256)
    elif kind == 1:
        found[at : at + 4] = struct.pack(">I", rng.choice([0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FC00000]))
    elif kind == 2:
        del found[at:]
    else:
        found[at:at] = rng.randbytes(rng.randint(1, 200))
    if rng.random() < 0.5 and len(found) >= HEADER.size:
        body = bytes(found[HEADER.size :])
        found[42:58] = struct.pack(">QQ", len(body), crc64(body))
    return bytes(found)


def outcome(found: bytes) -> str:
    """What becomes of a message; commands are read, and what is not finite is refused there."""
    try:
        commands = Incoming(3).commands(decode(decode_header(found[: HEADER.size]), found[HEADER.size :]))
    except (MalformedError, RefusedError) as fault:
        return type(fault).__name__
    for command in commands:
        assert read_command(command)
        assert np.isfinite([n for value in command.values() if isinstance(value, list) for n in value]).all()
    return "commands" if commands else "nothing"


def test_the_codec_refuses_what_is_no_message_and_nothing_else_happens():
    """Among two thousand some of each outcome come."""
    rng = random.Random(1)
    outcomes = Counter(outcome(mutated(rng)) for _ in range(2000))
    assert set(outcomes) == {"MalformedError", "RefusedError", "commands", "nothing"}
