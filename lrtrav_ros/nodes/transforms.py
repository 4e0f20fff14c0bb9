"""The pose of one frame in another, from tf as far as it is installed."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rclpy.time import Time

from lrtrav_ros.io.static_transforms import StaticTransforms
from lrtrav_ros.pose import Pose

try:
    import tf2_ros
except ImportError:  # no wheel has it; a robot's ROS does
    tf2_ros = None
try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None


class TransformLookup:
    """Looks frames up in tf: with ``tf2_ros`` all of them, with ``tf2_msgs`` alone those of ``/tf_static``.

    Parameters
    ----------
    node : rclpy.node.Node
        Subscribes.

    Attributes
    ----------
    problem : str
        Why the last pose that was asked for is not known, with the remedy; empty where it is.
    """

    def __init__(self, node: Node) -> None:
        self.problem = ""
        self._static = StaticTransforms()
        self._buffer: Any = None
        if tf2_ros is not None:
            self._buffer = tf2_ros.Buffer()
            self._listener = tf2_ros.TransformListener(self._buffer, node)
        elif TFMessage is not None:
            qos = QoSProfile(depth=100, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
            node.create_subscription(TFMessage, "/tf_static", self._static.add, qos)

    def pose(self, target: str, source: str, *, stamp_ns: int | None = None) -> Pose | None:
        """Return the pose of a frame in another one, which `problem` explains where it is None.

        Parameters
        ----------
        target, source : str
            The result turns points of `source` into points of `target`.
        stamp_ns : int, optional
            Time in nanoseconds; the newest there is by default.
        """
        if target.lstrip("/") == source.lstrip("/"):
            self.problem = ""
            return Pose.parsed("0 0 0 0 0 0 1")
        found = self._static.pose(target, source) if self._buffer is None else self._looked_up(target, source, stamp_ns)
        if found is not None:
            self.problem = ""
        elif self._buffer is None:
            self.problem = f"no transform from {source!r} to {target!r}: {self._remedy()}"
        return found

    def _looked_up(self, target: str, source: str, stamp_ns: int | None) -> Pose | None:
        try:
            stamped = self._buffer.lookup_transform(target, source, Time(nanoseconds=stamp_ns or 0))
            translation, rotation = stamped.transform.translation, stamped.transform.rotation
            return Pose.of_quaternion(
                (translation.x, translation.y, translation.z), (rotation.x, rotation.y, rotation.z, rotation.w)
            )
        except (tf2_ros.TransformException, ValueError) as err:
            self.problem = f"no transform from {source!r} to {target!r}: {err}"
            return None

    def _remedy(self) -> str:
        """Return what to do where tf2_ros is not there."""
        if TFMessage is None:
            return "install tf2_ros, which is not there"
        return "it is not in /tf_static; publish it there, or install tf2_ros for all of tf"


class DepthPose:
    """The pose of the depth camera in the left one: ``source.depth_pose``, or else from tf.

    Parameters
    ----------
    node : rclpy.node.Node
        Subscribes to tf where it is needed.
    text : str
        ``source.depth_pose``.
    """

    def __init__(self, node: Node, text: str) -> None:
        self._given = Pose.parsed(text) if text else None
        self._lookup = None if text else TransformLookup(node)

    def of(self, left: Any, depth: Any) -> Pose | None:
        """Return the pose for the frames that two CameraInfo name; None where it is not known."""
        if self._lookup is None:
            return self._given
        return self._lookup.pose(left.header.frame_id, depth.header.frame_id)

    @property
    def problem(self) -> str:
        """Why the pose is not known; empty where it is, or nobody asked."""
        problem = "" if self._lookup is None else self._lookup.problem
        return f"{problem}; or set source.depth_pose" if problem else ""
