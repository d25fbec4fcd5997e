"""The ROS 2 node of docs/ros2.md: its conversions by the message types of rosbags, its own lines with a stand-in.

Messages go through CDR, the encoding in which ROS 2 sends them, so that fields have the names, the types and the
lengths of their definitions. There is no rclpy here: what it does is not tested.
"""

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from dynamics import four_mass_phantom
from estimators import MarkMeasurement, Status, TargetEstimate, TissueFilter
from experiments.formats.scene.scene import Mark, Scene, Target, write_scene

NODE = Path(__file__).parents[2] / "docs" / "ros2_node.py"
NANOSEC = 123_456_789
SEC = 1_769_850_000
MARKED = ("M1", "M3", "M4")


class Ros:
    """Types of one release of ROS 2 under the names of its Python modules; rclpy's place is taken by this object."""

    def __init__(self, release: Stores) -> None:
        self.store = get_typestore(release)
        self.took: Any = None
        self.published: list[Any] = []
        self.warned: list[str] = []
        self.frames: list[Any] = []
        self.topics: list[tuple[str, str]] = []

    def type(self, name: str) -> Any:
        return self.store.types[name]

    def modules(self) -> dict[str, ModuleType]:
        """Modules to import from, by name."""
        made = {}
        for package in ("geometry_msgs", "visualization_msgs"):
            made[package], made[f"{package}.msg"] = ModuleType(package), ModuleType(f"{package}.msg")
            for name in self.store.types:
                if name.startswith(f"{package}/msg/"):
                    setattr(made[f"{package}.msg"], name.rsplit("/", 1)[1], self.type(name))
        made["rclpy"] = ModuleType("rclpy")
        made["rclpy"].init, made["rclpy"].spin, made["rclpy"].create_node = lambda: None, self.spin, lambda _: self
        return made

    def sent(self, message: Any) -> Any:
        """The message after it went through CDR."""
        name = message.__msgtype__
        return self.store.deserialize_cdr(self.store.serialize_cdr(message, name), name)

    def marks(self, *markers: tuple[str, tuple[float, float, float]], nanosec: int = NANOSEC, action: int = 0) -> Any:
        """A MarkerArray with the name and the place [m] of each mark, as it arrives."""
        return self.sent(
            self.type("visualization_msgs/msg/MarkerArray")([self.marker(*m, nanosec, action) for m in markers])
        )

    def marker(self, name: str, place: tuple[float, float, float], nanosec: int, action: int) -> Any:
        """One marker."""
        of, no_time = self.type, self.type("builtin_interfaces/msg/Duration")(0, 0)
        point, turned = of("geometry_msgs/msg/Point")(*place), of("geometry_msgs/msg/Quaternion")(0.0, 0.0, 0.0, 1.0)
        no_picture = of("sensor_msgs/msg/CompressedImage")(self.header(0), "", np.zeros(0, dtype=np.uint8))
        return of("visualization_msgs/msg/Marker")(
            header=self.header(nanosec),
            ns=name,
            id=0,
            type=2,
            action=action,
            pose=of("geometry_msgs/msg/Pose")(point, turned),
            scale=of("geometry_msgs/msg/Vector3")(0.01, 0.01, 0.01),
            color=of("std_msgs/msg/ColorRGBA")(1.0, 0.0, 0.0, 1.0),
            lifetime=no_time,
            frame_locked=False,
            points=[],
            colors=[],
            texture_resource="",
            texture=no_picture,
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=of("visualization_msgs/msg/MeshFile")("", np.zeros(0, dtype=np.uint8)),
            mesh_use_embedded_materials=False,
        )

    def header(self, nanosec: int) -> Any:
        """A header in the scene's axes."""
        return self.type("std_msgs/msg/Header")(self.type("builtin_interfaces/msg/Time")(SEC, nanosec), "tissue")

    def create_publisher(self, kind: Any, topic: str, _depth: int) -> Any:
        self.topics.append((kind.__msgtype__, topic))
        return SimpleNamespace(publish=lambda message: self.published.append(self.sent(message)))

    def create_subscription(self, kind: Any, topic: str, take: Any, _depth: int) -> None:
        self.topics.append((kind.__msgtype__, topic))
        self.took = take

    def get_logger(self) -> Any:
        return SimpleNamespace(warning=self.warned.append)

    def spin(self, _: Any) -> None:
        for frame in self.frames:
            self.took(frame)


@pytest.fixture(params=[Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY, Stores.ROS2_LYRICAL])
def ros(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Ros:
    made = Ros(request.param)
    for name, module in made.modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    return made


def functions() -> SimpleNamespace:
    return SimpleNamespace(**runpy.run_path(str(NODE)))


def test_marks_are_those_of_the_scene_in_its_dimension(ros: Ros) -> None:
    message = ros.marks(("M1", (0.1, -0.2, 0.3)), ("table", (9.0, 9.0, 9.0)), ("M3", (0.4, 0.5, 0.6)))
    for dim in (2, 3):
        time_s, marks = functions().marks_of(message, MARKED, dim, 2e-3)
        assert time_s == pytest.approx(1_769_850_000.123456789, abs=3e-7)  # a double's spacing there: 2.4e-7 s
        assert [mark.node for mark in marks] == ["M1", "M3"]
        assert marks[0].position.tolist() == [0.1, -0.2, 0.3][:dim]
        assert marks[1].position.tolist() == [0.4, 0.5, 0.6][:dim]
        assert np.array_equal(marks[1].cov, np.diag([2e-3**2] * dim))


def test_a_deleted_mark_was_not_seen_and_still_gives_the_time(ros: Ros) -> None:
    deleted = ros.type("visualization_msgs/msg/Marker").DELETEALL
    time_s, marks = functions().marks_of(ros.marks(("M1", (0.0, 0.0, 0.0)), action=deleted), MARKED, 2, 1e-3)
    assert time_s == pytest.approx(1_769_850_000.123456789, abs=3e-7)
    assert marks == []


def test_marks_of_two_moments_of_none_or_of_one_name_are_refused(ros: Ros) -> None:
    apart = ros.marks(("M1", (0.0, 0.0, 0.0)))
    apart.markers += ros.marks(("M3", (0.0, 0.0, 0.0)), nanosec=0).markers
    twice = ros.marks(("M1", (0.0, 0.0, 0.0)), ("M1", (0.1, 0.0, 0.0)))
    for message in (apart, ros.marks(), twice):
        with pytest.raises(ValueError, match="expected one stamp, each name once; found "):
            functions().marks_of(message, MARKED, 2, 1e-3)


def test_an_estimate_in_space(ros: Ros) -> None:
    """In m, m² and rad²: rows x, y, z, then rotations about them; an angle uniform in 2 pi has (2 pi)² / 12."""
    cov = 1e-6 * np.array([[4.0, 1.0, 0.5], [1.0, 9.0, -2.0], [0.5, -2.0, 16.0]])
    estimate = TargetEstimate(0.0, np.array([0.1, -0.2, 0.3]), cov, Status.TRACKING, 3)
    found = ros.sent(functions().pose_of(estimate, ros.header(NANOSEC)))
    assert found.__msgtype__ == "geometry_msgs/msg/PoseWithCovarianceStamped"
    assert (found.header.stamp.sec, found.header.stamp.nanosec, found.header.frame_id) == (SEC, NANOSEC, "tissue")
    place, turned = found.pose.pose.position, found.pose.pose.orientation
    assert (place.x, place.y, place.z) == (0.1, -0.2, 0.3)
    assert (turned.x, turned.y, turned.z, turned.w) == (0.0, 0.0, 0.0, 1.0)
    whole = found.pose.covariance.reshape(6, 6)
    assert np.array_equal(whole[:3, :3], cov)
    np.testing.assert_allclose(whole[3:, 3:], (2.0 * np.pi) ** 2 / 12.0 * np.eye(3), rtol=1e-15)
    assert not whole[:3, 3:].any()
    assert not whole[3:, :3].any()


def test_an_estimate_in_the_plane_is_at_z_of_0_without_variance(ros: Ros) -> None:
    cov = np.array([[3.0, 0.5], [0.5, 4.0]])
    estimate = TargetEstimate(0.0, np.array([1.0, 2.0]), cov, Status.TRACKING, 3)
    found = ros.sent(functions().pose_of(estimate, ros.header(NANOSEC))).pose
    assert (found.pose.position.x, found.pose.position.y, found.pose.position.z) == (1.0, 2.0, 0.0)
    whole = found.covariance.reshape(6, 6)
    assert np.array_equal(whole[:2, :2], cov)
    assert not whole[2].any()


def test_the_node_publishes_what_the_filter_estimates(ros, tmp_path, monkeypatch):
    """A frame that comes late is reported and changes nothing; estimates without a place are not published."""
    phantom = four_mass_phantom()
    marks = tuple(Mark(node, 0.0, 0.03) for node in MARKED)
    write_scene(Scene(phantom, marks, Target("M2", 0.005), ()), tmp_path / "scene.toml")
    at = {node: (*phantom.positions[phantom.index(node)].tolist(), 0.0) for node in MARKED}
    times_ns = [100_000_000 * k for k in range(8)]
    frames = [ros.marks(*at.items(), nanosec=time_ns) for time_ns in times_ns]
    none_seen = ros.marks(("", (0.0, 0.0, 0.0)), nanosec=800_000_000, action=3)
    ros.frames = [*frames[:5], frames[0], *frames[5:], none_seen]
    monkeypatch.setattr(sys, "argv", [str(NODE), str(tmp_path / "scene.toml"), "1.5"])
    runpy.run_path(str(NODE), run_name="__main__")
    tissue = TissueFilter(phantom, "M2", MARKED)
    seen = [MarkMeasurement(node, np.array(place[:2]), 1.5e-3**2 * np.eye(2)) for node, place in at.items()]
    estimates = {}
    for time_ns in times_ns:
        tissue.predict(SEC + 1e-9 * time_ns)
        estimates[time_ns] = tissue.update(seen)
    tissue.predict(SEC + 0.8)
    estimates[800_000_000] = tissue.update([])
    assert estimates[800_000_000].status is Status.COASTING
    expected = {time_ns: one for time_ns, one in estimates.items() if one.status is not Status.INITIALISING}
    assert 1 < len(expected) < len(estimates)
    assert [one.header.stamp.nanosec for one in ros.published] == list(expected)
    for one, estimate in zip(ros.published, expected.values(), strict=True):
        place = one.pose.pose.position  # up to the digits of the scene's file
        np.testing.assert_allclose([place.x, place.y], estimate.mean, atol=1e-9)
        np.testing.assert_allclose(one.pose.covariance.reshape(6, 6)[:2, :2], estimate.cov, rtol=1e-6, atol=1e-12)
    assert len(ros.warned) == 1
    assert "time_s: expected 1769850000.4 or later, found 1769850000.0" in ros.warned[0]
    assert ros.topics == [
        ("geometry_msgs/msg/PoseWithCovarianceStamped", "target/pose"),
        ("visualization_msgs/msg/MarkerArray", "marks"),
    ]


def test_the_node_has_fifty_lines_at_most() -> None:
    assert len(NODE.read_text(encoding="utf-8").splitlines()) <= 50
