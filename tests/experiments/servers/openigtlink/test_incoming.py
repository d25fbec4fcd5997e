"""What clients send, as commands: messages made by pyigtl."""

import numpy as np
import pytest
from pyigtl.messages import PointMessage, StringMessage, TransformMessage

from experiments.servers.commands import UNSEEN, read_command
from experiments.servers.openigtlink.codec import HEADER, Message, decode, decode_header
from experiments.servers.openigtlink.incoming import Incoming, RefusedError


def sent(theirs) -> Message:
    """A message of pyigtl's as it comes here."""
    found = theirs.pack()
    return decode(decode_header(found[: HEADER.size]), found[HEADER.size :])


def pose(direction, tip, status: str | None = None, device: str = "NeedleTipToReference") -> Message:
    """A needle's TRANSFORM: shaft along -z, tip in the origin."""
    z = np.array(direction) / np.linalg.norm(direction)
    x = np.cross([0.36, 0.48, 0.8], z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3] = np.column_stack([x, np.cross(z, x), z, tip])
    theirs = TransformMessage(matrix, device_name=device)
    if status is not None:
        theirs.header_version, theirs.metadata = 2, {"TransformStatus": status}
    return sent(theirs)


def points(*places, name: str = "F") -> Message:
    """Fiducials."""
    names = [f"{name}-{i}" for i in range(len(places))]
    return sent(PointMessage(positions=list(places), names=names, device_name="F"))


@pytest.mark.parametrize(("dim", "direction"), [(3, [1 / 3, 2 / 3, 2 / 3]), (2, [0.0, 0.8, 0.6])])
def test_a_tracked_needle_is_a_command(dim: int, direction: list[float]):
    """In a plane two numbers of it count."""
    (command,) = Incoming(dim).commands(pose(direction, [10.0, -20.0, 30.0]))
    assert (command["command"], command["tip_mm"]) == ("needle", [10.0, -20.0, 30.0][:dim])
    assert command["direction"] == pytest.approx(direction[:dim], abs=1e-6)


@pytest.mark.parametrize(
    ("status", "command"),
    [
        (None, "needle"),
        ("OK", "needle"),
        ("MISSING", "needle_unseen"),
        ("INVALID", "needle_unseen"),
        ("OUT_OF_VIEW", "needle_unseen"),
    ],
)
def test_a_needle_that_its_tracker_does_not_see_is_said_to_be_unseen(status, command: str):
    (found,) = Incoming(3).commands(pose([0.0, 0.0, 1.0], [1.0, 2.0, 3.0], status))
    assert found["command"] == command
    read_command(found)


@pytest.mark.parametrize(("at", "value"), [((0, 3), np.nan), ((1, 3), np.inf), ((2, 2), np.nan)])
def test_a_pose_of_no_numbers_is_that_of_an_unseen_needle(at: tuple[int, int], value: float):
    matrix = np.eye(4)
    matrix[at] = value
    assert Incoming(3).commands(sent(TransformMessage(matrix, device_name="NeedleTipToReference"))) == [UNSEEN]


def turned(axis: int, degrees: float) -> np.ndarray:
    """A rotation about an axis, (3, 3)."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.eye(3)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    matrix[a, a] = matrix[b, b] = c
    matrix[a, b], matrix[b, a] = -s, s
    return matrix


NO_ROTATIONS = {
    "mirrored in z": np.diag([1.0, 1.0, -1.0]),
    "z leans to x by a degree": np.column_stack([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], turned(1, 1.0)[:, 2]]),
    "two axes are one": np.eye(3)[:, [0, 0, 2]],
    "larger": 1.03 * np.eye(3),
    "smaller": 0.97 * np.eye(3),
    "one axis longer": np.diag([1.0, 1.02, 1.0]),
    "nothing": np.zeros((3, 3)),
    "turned and mirrored": turned(1, 33.0) @ np.diag([1.0, -1.0, 1.0]),
}


def needle(axes: np.ndarray, tip_mm: tuple[float, float, float] = (1.0, 2.0, 3.0)) -> Message:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes, tip_mm
    return sent(TransformMessage(matrix, device_name="NeedleTipToReference"))


INTO_THE_PLANE = turned(0, -90.0)
NO_NEEDLES = {
    **{f"{name}, in space": (3, needle(axes), "needle: expected") for name, axes in NO_ROTATIONS.items()},
    **{f"{name}, flat": (2, needle(INTO_THE_PLANE @ axes), "needle: expected") for name, axes in NO_ROTATIONS.items()},
    "across the plane": (2, pose([0.3, 0.1, 0.9], [0.0, 0.0, 0.0]), "plane"),
    "a tip 10 m away": (3, needle(np.eye(3), (0.0, 0.0, 10_001.0)), "needle.tip_mm"),
}


@pytest.mark.parametrize("name", NO_NEEDLES)
def test_a_pose_that_no_needle_has_is_one_that_is_not_seen(name: str):
    dim, message, said = NO_NEEDLES[name]
    with pytest.raises(RefusedError, match=said) as refused:
        Incoming(dim).commands(message)
    assert refused.value.instead == (UNSEEN,)


@pytest.mark.parametrize("axes", [turned(a, d) for a in range(3) for d in (30.0, 180.0)])
def test_every_rotation_is_taken_with_the_rounding_of_trackers(axes: np.ndarray):
    for rounded in (axes, np.round(axes, 3), 1.002 * axes):
        (command,) = Incoming(3).commands(needle(rounded))
        assert command["direction"] == pytest.approx(rounded[:, 2].tolist(), abs=1e-6)


def test_points_are_sightings_of_the_target():
    assert Incoming(3).commands(points([1.0, 2.0, 3.0], [4.5, 5.0, 6.0])) == [
        {"command": "fix", "place_mm": [1.0, 2.0, 3.0]},
        {"command": "fix", "place_mm": [4.5, 5.0, 6.0]},
    ]
    assert Incoming(2).commands(points([1.0, 2.0, 3.0])) == [{"command": "fix", "place_mm": [1.0, 2.0]}]


def test_a_list_sent_again_for_a_point_more_is_that_point():
    """Slicer sends the whole list whenever one is added or moved."""
    incoming = Incoming(3)
    assert len(incoming.commands(points([1.0, 2.0, 3.0]))) == 1
    assert incoming.commands(points([1.0, 2.0, 3.0])) == []
    assert [c["place_mm"] for c in incoming.commands(points([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]))] == [[4.0, 5.0, 6.0]]
    assert [c["place_mm"] for c in incoming.commands(points([1.0, 2.5, 3.0], [4.0, 5.0, 6.0]))] == [[1.0, 2.5, 3.0]]


def test_a_hundred_points_are_taken_and_no_more():
    assert len(Incoming(3).commands(points(*([1.0, 2.0, z] for z in range(100))))) == 100
    with pytest.raises(RefusedError, match="at most 100"):
        Incoming(3).commands(points(*([1.0, 2.0, z] for z in range(101))))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -10_001.0])
def test_one_point_that_is_none_refuses_all(bad: float):
    with pytest.raises(RefusedError, match="place_mm"):
        Incoming(3).commands(points([1.0, 2.0, 3.0], [bad, 0.0, 0.0]))


@pytest.mark.parametrize(
    "message",
    [
        sent(StringMessage("hello", device_name="NeedleTipToReference")),
        Message("GET_STATUS", "Softaim", b""),
        Message("STT_TRANSFOR", "", b""),
        Message("STP_TDATA", "", b"\1\2\3"),
        Message("COMMAND", "x", bytes(200)),
        Message("TRANSFORM", "ProbeToTracker", b"of another size"),
        pose([0.0, 0.0, 1.0], [1.0, 2.0, 3.0], device="StylusTipToReference"),
    ],
    ids=lambda message: message.type,
)
def test_anything_else_asks_for_nothing(message: Message):
    incoming = Incoming(3)
    assert incoming.commands(message) == []
    assert not incoming.sends_needle
