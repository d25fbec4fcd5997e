"""An MCAP file says what the recording and its results say, to ROS 2's own tools."""

import io
import json
import re
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from experiments.errors import InputError
from experiments.formats.recording import read_recording
from experiments.pipeline.exchange.ros import export_mcap, node_topics
from tests.experiments.commands.good_files import ESTIMATES
from tests.experiments.pipeline.exchange.recordings import export_of, write_filmed

START = "2026-01-31T10:00:00+01:00"
START_NS = 1_769_850_000 * 10**9
"""By `date -u -d 2026-01-31T09:00:00Z +%s`."""


def messages(folder: Path, name: str, results: str | None, start: str | None = None) -> dict[str, list[Any]]:
    """Times [ns] and messages by topic; they come in the order of time."""
    stream = io.BytesIO()
    counts = export_mcap(export_of(folder, name, results, start), stream)
    stream.seek(0)
    reader = make_reader(stream, decoder_factories=[DecoderFactory()])
    assert reader.get_header().profile == "ros2"
    found: dict[str, list[Any]] = {}
    last_ns = 0
    for _, channel, message, content in reader.iter_decoded_messages(log_time_order=False):
        assert message.log_time == message.publish_time >= last_ns
        last_ns = message.log_time
        assert message.sequence == len(found.setdefault(channel.topic, []))
        found[channel.topic].append((message.log_time, content))
    assert counts == {topic: len(own) for topic, own in found.items()}
    return found


def test_pictures_are_those_of_the_recording(tmp_path: Path) -> None:
    images = write_filmed(tmp_path)
    found = messages(tmp_path, "filmed", None, START)["/camera/image/compressed"]
    assert [time_ns - START_NS for time_ns, _ in found] == [0, 10**8, 2 * 10**8]
    for (time_ns, content), image in zip(found, images, strict=True):
        assert content.header.stamp.sec * 10**9 + content.header.stamp.nanosec == time_ns
        assert (content.header.frame_id, content.format) == ("front", "jpeg")
        shown = cv2.imdecode(np.frombuffer(content.data, dtype=np.uint8), cv2.IMREAD_COLOR)
        assert shown.shape == image.shape
        # colours are coarser than light: at the edges of blocks they run
        np.testing.assert_allclose(shown[8::16, 8::16].astype(float), image[8::16, 8::16], atol=4)


def test_the_start_is_the_time_of_the_first_frame(tmp_path: Path) -> None:
    """To the nanosecond, whatever the recording's clock says; without it, times are the clock's."""
    write_filmed(tmp_path)
    frames = tmp_path / "filmed" / "frames.csv"
    frames.write_text("frame,exposure_s\n0,33763.609654306\n1,33763.642987639\n2,33763.676320972\n")
    (tmp_path / "filmed" / "fixes.csv").write_text("time_s,x_mm,y_mm,sd_mm\n33763.65,0,188,1\n")
    found = messages(tmp_path, "filmed", None, START)["/camera/image/compressed"]
    assert [time_ns - START_NS for time_ns, _ in found] == [0, 33_333_333, 66_666_666]
    found = messages(tmp_path, "filmed", None)["/camera/image/compressed"]
    assert found[0][0] == 33_763_609_654_306


def test_only_what_is_trusted_is_a_pose(files: Path) -> None:
    """Of three rows one is TRACKING; all three say what they say."""
    found = messages(files, "filmed", "results")
    ((time_ns, pose),) = found["/target/pose"]
    assert time_ns == 10**8
    place = pose.pose.pose.position
    assert (place.x, place.y, place.z) == pytest.approx((0.001, 0.189, 0.0))
    covariance = np.reshape(pose.pose.covariance, (6, 6))[:2, :2]
    np.testing.assert_allclose(covariance, [[1e-6, 0.25e-6], [0.25e-6, 2e-6]], rtol=1e-12)
    said = [json.loads(content.data) for _, content in found["/target/estimate"]]
    assert [one["status"] for one in said] == ["INITIALISING", "TRACKING", "LOST"]
    first = dict(zip(ESTIMATES.splitlines()[0].split(","), ESTIMATES.splitlines()[1].split(","), strict=True))
    assert {key: "" if value is None else str(value) for key, value in said[0].items()} == first | {
        key: f"{float(first[key])}" for key in ("time_s", "x_mm", "y_mm", "xx", "xy", "yy", "marks_used", "poked")
    }
    advised = [json.loads(content.data) for _, content in found["/advice"]]
    none = ("NO_GUIDANCE", None)
    assert [(one["advice"], one["p_hit"]) for one in advised] == [none, ("GO", 0.97), none]
    ((fixed_ns, fix),) = found["/target/fix"]
    assert fixed_ns == 10**8
    assert fix.pose.pose.position.y == pytest.approx(0.188)
    assert fix.pose.covariance[0] == pytest.approx(1e-6)


def test_marks_of_another_tracker_are_points(files: Path) -> None:
    found = messages(files, "marks", None)
    assert set(found) == {"/marks/M1", "/marks/M3", "/marks/M4", "/target/fix"}
    assert [time_ns for time_ns, _ in found["/marks/M1"]] == [0, 10**8, 2 * 10**8]
    network = read_recording(files / "marks").scene.network
    for node in ("M1", "M3", "M4"):
        for _, content in found[f"/marks/{node}"]:
            place = (content.point.x, content.point.y)
            assert place == pytest.approx(tuple(network.positions[network.index(node)]), abs=5e-6)
            assert content.header.frame_id == "reference"


def test_a_body_in_space_has_its_depth(tmp_path: Path) -> None:
    (tmp_path / "space").mkdir()
    shutil.copy(Path(__file__).parents[2] / "hanging.toml", tmp_path / "space" / "scene.toml")
    (tmp_path / "space" / "marks.csv").write_text("time_s,node,x_mm,y_mm,z_mm,sd_mm\n0.5,a,1,-100,20,0.5\n")
    (tmp_path / "run").mkdir()
    header = "time_s,status,x_mm,y_mm,z_mm,xx,xy,yy,xz,yz,zz"
    (tmp_path / "run" / "estimates.csv").write_text(f"{header}\n0.5,COASTING,1,-50,10,4,1,9,0.5,-2,16\n")
    found = messages(tmp_path, "space", "run")
    ((_, seen),) = found["/marks/a"]
    assert (seen.point.x, seen.point.y, seen.point.z) == pytest.approx((0.001, -0.1, 0.02))
    ((_, pose),) = found["/target/pose"]
    place = pose.pose.pose.position
    assert (place.x, place.y, place.z) == pytest.approx((0.001, -0.05, 0.01))
    covariance = 1e6 * np.reshape(pose.pose.covariance, (6, 6))[:3, :3]
    np.testing.assert_allclose(covariance, [[4.0, 1.0, 0.5], [1.0, 9.0, -2.0], [0.5, -2.0, 16.0]], rtol=1e-9)


def test_a_run_that_was_elsewhere_is_refused(tmp_path: Path) -> None:
    write_filmed(tmp_path)
    path = tmp_path / "results" / "estimates.csv"
    path.write_text(path.read_text().replace("\n0", "\n100"))
    with pytest.raises(InputError, match=r"expected times of the recording's frames, 0 to 0.2 s, found 100 to 100.2 s"):
        export_of(tmp_path, "filmed", "results")


def test_times_that_ros_cannot_hold_are_refused(files: Path) -> None:
    with pytest.raises(InputError, match=r"--start: expected frames from 1970 to 2038"):
        export_of(files, "filmed", start="2038-01-19T03:14:08Z")


def test_topics_are_names_that_ros_can_have() -> None:
    """ROS 2, "Topic and service names": letters, digits and single underscores, no digit first."""
    names = ("M1", "tip 1", "tip_1", "tip-1", "2nd", "左", "右", "tip_1_2", "_")
    found = node_topics(names)
    assert list(found) == list(names)
    assert found["M1"] == "/marks/M1"
    assert len(set(found.values())) == len(names)
    for topic in found.values():
        assert re.fullmatch(r"/marks/[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*", topic), topic
