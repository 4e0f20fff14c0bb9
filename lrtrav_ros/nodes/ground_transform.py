"""The ground frame below the camera, on ``/tf`` where the messages of tf2 are installed."""

from __future__ import annotations

from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from rclpy.node import Node
from std_msgs.msg import Header

from lrtrav_ros.mapping.ground_frame import GroundFrame, ground_frame_id

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # no wheel has it; a robot's ROS does
    TFMessage = None


class GroundTransform:
    """Publishes the ground frame as a child of the camera's frame, of which the robot knows the parent.

    Parameters
    ----------
    node : rclpy.node.Node
        Publishes, where `tf2_msgs` is installed.
    """

    def __init__(self, node: Node) -> None:
        self._publisher = None if TFMessage is None else node.create_publisher(TFMessage, "/tf", 100)

    def publish(self, ground: GroundFrame, header: Header) -> None:
        """Publish where the ground frame is at the time of an image, whose header this is."""
        if self._publisher is not None:
            self._publisher.publish(TFMessage(transforms=[transform_of(ground, header)]))


def transform_of(ground: GroundFrame, header: Header) -> TransformStamped:
    """Return the transform from the camera's frame, which a header names, to the ground frame."""
    x, y, z = ground.pose_in_camera.translation_m.tolist()
    qx, qy, qz, qw = ground.quaternion
    return TransformStamped(
        header=header,
        child_frame_id=ground_frame_id(header.frame_id),
        transform=Transform(translation=Vector3(x=x, y=y, z=z), rotation=Quaternion(x=-qx, y=-qy, z=-qz, w=qw)),
    )
