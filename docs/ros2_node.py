"""A ROS 2 node that estimates the target from a tracker's marks: python3 ros2_node.py SCENE SD_MM."""

import sys

import numpy as np
import rclpy
from geometry_msgs.msg import Point, Pose, PoseWithCovariance, PoseWithCovarianceStamped, Quaternion
from visualization_msgs.msg import MarkerArray

from softaim import MarkMeasurement, TissueFilter, read_scene


def marks_of(message, nodes, dim, sd_m):
    """The exposure time [s] of a MarkerArray, and its marks on these nodes; sd_m: standard deviation per axis [m]."""
    times_s = {m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in message.markers}
    seen = [(m.ns, m.pose.position) for m in message.markers if m.action == m.ADD and m.ns in nodes]
    if len(times_s) != 1 or len(dict(seen)) != len(seen):
        raise ValueError(f"expected one stamp, each name once; found {sorted(times_s)}, {[name for name, _ in seen]}")
    return times_s.pop(), [MarkMeasurement(name, [at.x, at.y, at.z][:dim], sd_m**2 * np.eye(dim)) for name, at in seen]


def pose_of(estimate, header):
    """A PoseWithCovarianceStamped: no rotation, with the variance of unknown angles, uniform from -pi to pi."""
    dim, place, cov = len(estimate.mean), np.zeros(3), np.diag([0.0] * 3 + [np.pi**2 / 3.0] * 3)
    place[:dim], cov[:dim, :dim] = estimate.mean, estimate.cov
    pose = Pose(position=Point(x=place[0], y=place[1], z=place[2]), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0))
    return PoseWithCovarianceStamped(header=header, pose=PoseWithCovariance(pose=pose, covariance=cov.ravel()))


if __name__ == "__main__":
    rclpy.init()
    scene, sd_m = read_scene(sys.argv[1]), 1e-3 * float(sys.argv[2])
    nodes = scene.measured_nodes
    tissue = TissueFilter(scene.network, scene.target.point, nodes, scene.settings, uncertainty=scene.uncertainty)
    node = rclpy.create_node("softaim")
    poses = node.create_publisher(PoseWithCovarianceStamped, "target/pose", 10)

    def take(message):
        """Publish the target at the exposure time of a message."""
        try:
            time_s, marks = marks_of(message, nodes, scene.network.dim, sd_m)
            tissue.predict(time_s)
            estimate = tissue.update(marks)
            if estimate.status in ("TRACKING", "COASTING"):
                poses.publish(pose_of(estimate, message.markers[0].header))
        except (ValueError, ArithmeticError) as fault:
            node.get_logger().warning(str(fault))

    node.create_subscription(MarkerArray, "marks", take, 10)
    rclpy.spin(node)
