"""What is sent of a moment, read by pyigtl where it can, and by our own codec, which has tests of its own."""

import json

import numpy as np
import pytest
from scipy.stats import chi2

from estimators import Advice, Guidance, Insertion, Status, TargetEstimate
from experiments.servers.message import state_message
from experiments.servers.openigtlink.bodies import read_transform
from experiments.servers.openigtlink.codec import HEADER, Message, decode, decode_header
from experiments.servers.openigtlink.outgoing import (
    FLAT_MM,
    LONGEST_TEXT,
    Code,
    Packet,
    needle_matrix,
    packet_of,
    sphere_message,
    spread_matrix,
)
from tests.experiments.servers.openigtlink.connections import UTC_S, state, status_in
from tests.experiments.servers.page.messages import shown

TRANSFORMS = {"TargetToReference", "SpreadToReference", "NeedleTipToReference"}
IN_SPACE = {
    "target_mm": [1.0, 2.0, 3.0],
    "cov_mm2": [[4.0, 1.0, 0.5], [1.0, 2.0, -0.3], [0.5, -0.3, 1.0]],
    "needle": {"tip_mm": [10.0, -50.0, 7.0], "direction": [1.0, -2.0, 2.0]},
}


def messages(sent: Packet | bytes) -> dict[str, Message]:
    """All messages in these bytes by device."""
    found = sent if isinstance(sent, bytes) else sent.common + sent.needle
    all_of_them = {}
    while found:
        header = decode_header(found[: HEADER.size])
        end = HEADER.size + header.size
        all_of_them[header.device] = decode(header, found[HEADER.size : end])
        found = found[end:]
    return all_of_them


def said(**other) -> dict:
    """What the STRING of a state holds."""
    return json.loads(messages(packet_of(state(**other)))["SoftaimState"].content[4:])


def test_a_moment_is_two_or_three_transforms_a_status_and_a_string_of_its_exposure_time():
    found = messages(packet_of(state()))
    others = {"Softaim": "STATUS", "SoftaimState": "STRING"}
    assert {name: message.type for name, message in found.items()} == dict.fromkeys(TRANSFORMS, "TRANSFORM") | others
    assert {message.utc_s for message in found.values()} == {UTC_S}


@pytest.mark.parametrize(
    ("other", "missing"),
    [
        ({"needle": None}, {"NeedleTipToReference"}),
        ({"needle": {"tip_mm": None, "direction": [0.0, 1.0]}}, {"NeedleTipToReference"}),
        ({"needle": {"tip_mm": [0.0, 0.0], "direction": [0.0, 0.0]}}, {"NeedleTipToReference"}),
        ({"cov_mm2": None}, {"SpreadToReference"}),
        ({"target_mm": None}, {"TargetToReference", "SpreadToReference"}),
        ({"target_mm": [1e39, 0.0]}, {"TargetToReference", "SpreadToReference"}),  # beyond 32 bits
    ],
)
def test_what_has_no_place_is_not_sent(other, missing):
    assert set(messages(packet_of(state(**other)))) == {*TRANSFORMS, "Softaim", "SoftaimState"} - missing


def published(
    estimate: TargetEstimate, guidance: Guidance | None = None, insertion: Insertion | None = None
) -> dict[str, Message]:
    """Messages of a state as the loop publishes it."""
    given = state_message(shown(estimate, guidance, insertion), utc_s=UTC_S, memory_mb=None)
    return messages(packet_of(json.loads(json.dumps(given))))


def test_a_state_as_the_loop_publishes_it():
    """In metres there, in mm here; without anything that may be missing two messages remain."""
    mean, cov = np.array([0.001, -0.002, 0.5]), 1e-6 * np.diag([1.0, 4.0, 9.0])
    needle = Insertion(np.array([0.01, 0.0, 0.2]), np.array([0.0, 0.0, 1.0]), 0.1)
    estimate = TargetEstimate(2.0, mean, cov, Status.TRACKING, 3, 5.0, 0.1)
    found = published(estimate, Guidance(Advice.WAIT, "later", probability=0.5), needle)
    assert json.loads(found["SoftaimState"].content[4:])["advice"] == "WAIT"
    assert read_transform(found["TargetToReference"].content)[:3, 3] == pytest.approx([1.0, -2.0, 500.0])
    assert read_transform(found["NeedleTipToReference"].content)[:3, 3] == pytest.approx([10.0, 0.0, 200.0])
    lengths = np.linalg.norm(read_transform(found["SpreadToReference"].content)[:3, :3], axis=0)
    assert sorted(lengths) == pytest.approx(np.sqrt(chi2(3).ppf(0.95)) * np.array([1.0, 2.0, 3.0]), rel=1e-6)
    nothing = published(TargetEstimate(2.0, np.full(3, np.nan), None, Status.INITIALISING, 0))
    assert set(nothing) == {"Softaim", "SoftaimState"}
    assert json.loads(nothing["SoftaimState"].content[4:])["advice"] is None


@pytest.mark.parametrize(
    ("other", "status", "code", "name"),
    [
        ({}, "OK", Code.OK, "TRACKING"),
        ({"status": "COASTING"}, "MISSING", Code.NOT_FOUND, "COASTING"),
        ({"status": "INITIALISING"}, "INVALID", Code.NOT_READY, "INITIALISING"),
        ({"status": "DIVERGED"}, "INVALID", Code.UNKNOWN_ERROR, "DIVERGED"),
        ({"fault": "the camera is frozen"}, "INVALID", Code.UNKNOWN_ERROR, "FAULT"),
        ({"fault": "the camera is frozen", "status": "COASTING"}, "INVALID", Code.UNKNOWN_ERROR, "FAULT"),
        ({"paused": True}, "INVALID", Code.DISABLED, "PAUSED"),
        ({"status": "LOST"}, None, Code.NOT_PRESENT, "LOST"),
        ({"status": "LOST", "fault": "unplugged"}, None, Code.UNKNOWN_ERROR, "FAULT"),
    ],
)
def test_the_status_of_the_estimate_is_that_of_its_transforms(other, status, code, name):
    found = messages(packet_of(state(**other)))
    validity = {device: found[device].metadata for device in TRANSFORMS & set(found)}
    assert validity == ({} if status is None else {device: {"TransformStatus": status} for device in TRANSFORMS})
    assert status_in(found["Softaim"]) == (code, name)
    assert said(**other)["transform_status"] == status


def test_the_string_holds_covariance_health_probability_and_advice():
    usual, without = said(), said(advice=None)
    assert usual["cov_mm2"] == [[4.0, 1.0], [1.0, 2.0]]
    assert (usual["status"], usual["probability"], usual["advice"]) == ("TRACKING", 0.97, "GO")
    assert len(said(fault="x" * 9999)["fault"]) == LONGEST_TEXT
    assert (without["probability"], without["advice"], without["reason"]) == (None, None, None)


@pytest.mark.parametrize("other", [{"fault": "frozen"}, {"paused": True}, {"status": "LOST"}, {"status": "DIVERGED"}])
@pytest.mark.parametrize(
    ("advice", "sent"), [("GO", None), ("WAIT", "WAIT"), ("REALIGN", "REALIGN"), ("ABORT", "ABORT")]
)
def test_no_go_is_sent_of_what_may_not_be_relied_upon(other, advice: str, sent: str | None):
    found = said(advice={"advice": advice, "reason": "why", "probability": 0.97}, **other)
    assert found["advice"] == sent
    assert (found["probability"] is None) == (sent is None)


@pytest.mark.parametrize(
    "cov", [IN_SPACE["cov_mm2"], np.diag([1.0, 2.0, 3.0]).tolist(), np.diag([3.0, 2.0, 1.0]).tolist()]
)
def test_the_spread_is_right_handed_and_its_square_is_the_covariance(cov):
    """A A' = 7.81 P, whatever the order and signs of the axes; mirrored, a model would be seen from inside."""
    matrix = spread_matrix(state(**IN_SPACE | {"cov_mm2": cov}))
    axes = matrix[:3, :3]
    assert matrix[:3, 3].tolist() == IN_SPACE["target_mm"]
    assert axes @ axes.T == pytest.approx(chi2(3).ppf(0.95) * np.array(cov), rel=1e-9, abs=1e-9)
    assert np.linalg.det(axes) > 0.0


def test_in_a_plane_the_spread_is_flat():
    axes = spread_matrix(state())[:3, :3]
    assert axes[:2, :2] @ axes[:2, :2].T == pytest.approx(chi2(2).ppf(0.95) * np.array([[4.0, 1.0], [1.0, 2.0]]))
    assert axes[2, 2] == FLAT_MM
    assert not axes[2, :2].any()
    assert not axes[:2, 2].any()
    assert np.linalg.det(axes) > 0.0


@pytest.mark.parametrize(
    "direction", [[1.0, -2.0, 2.0], [3.0, 1.0, -2.0], [0.0, 0.0, 1.0], [0.0, 0.0, -3.0], [1.0, 0.0], [0.6, 0.8]]
)
def test_the_needle_points_along_z_from_its_tip(direction):
    tip = [10.0, -50.0, 7.0][: len(direction)]
    matrix = needle_matrix(state(needle={"tip_mm": tip, "direction": direction}))
    along = np.r_[direction, np.zeros(3 - len(direction))]
    assert matrix[:3, 2] == pytest.approx(along / np.linalg.norm(along))
    assert matrix[:3, 3].tolist() == [*tip, *[0.0] * (3 - len(tip))]
    assert matrix[:3, :3].T @ matrix[:3, :3] == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1.0)


def test_the_sphere_has_a_name_of_its_own():
    (message,) = messages(sphere_message()).values()
    assert (message.type, message.device) == ("POLYDATA", "Spread")
    assert len(message.content) < 16384
