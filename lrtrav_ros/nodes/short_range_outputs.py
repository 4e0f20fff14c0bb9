"""What the short-range node publishes of a frame."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from stereo_msgs.msg import DisparityImage

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config, SourceConfig
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.topics import DISPARITY, GROUND_DISPARITY, LEFT_IMAGE, OCCUPANCY
from lrtrav_ros.mapping.ground_frame import GroundFrame
from lrtrav_ros.mapping.points import free_points, obstacle_points
from lrtrav_ros.mapping.pose_smoothing import PoseSmoother
from lrtrav_ros.method.ground import ShortRange
from lrtrav_ros.nodes import messages
from lrtrav_ros.nodes.endpoints import Output
from lrtrav_ros.nodes.ground_transform import GroundTransform
from lrtrav_ros.nodes.row_check import RowCheck


class ShortRangeOutputs:
    """The publishers of the short-range node.

    Parameters
    ----------
    node : rclpy.node.Node
        Publishes.
    config : SourceConfig
        Where disparity is the source, it is not published; where images are rectified, the left one is.

    Attributes
    ----------
    occupancy : Output
        ``short_range/occupancy``, which the long-range node waits for.
    left : Output or None
        The rectified left image; None where it comes rectified.
    """

    def __init__(self, node: Node, config: SourceConfig) -> None:
        self.left = Output(node, LEFT_IMAGE) if config.rectify and config.source == "stereo" else None
        self.occupancy = Output(node, OCCUPANCY)
        self._disparity = Output(node, DISPARITY, DisparityImage) if config.source != "disparity" else None
        self._ground_disparity = Output(node, GROUND_DISPARITY, DisparityImage)
        self._mask = Output(node, "short_range/mask")
        self._depth = Output(node, "depth")
        self._obstacles = Output(node, "obstacles", PointCloud2)
        self._free = Output(node, "free", PointCloud2)
        self._ground_pose = Output(node, "short_range/ground_pose", PoseStamped)
        self._u_disparity = Output(node, "short_range/u_disparity")
        self._v_disparity = Output(node, "short_range/v_disparity")
        self._obstacle_disparity = Output(node, "short_range/obstacle_disparity")
        self._transform = GroundTransform(node)
        self._smoother = PoseSmoother()
        self._rows = RowCheck()

    def problem(self) -> str:
        """Return what is wrong with the frames; empty where nothing is."""
        return self._rows.problem()

    def forget(self) -> None:
        """Forget the frames before."""
        self._smoother = PoseSmoother()
        self._rows = RowCheck()

    def publish_left(self, header: Header, frame: Frame) -> None:
        """Publish the left image where it was rectified here: another process may look at it while this one matches."""
        if self.left is not None and (left := frame.left) is not None:
            self.left.publish_image(lambda: left, header)

    def publish(self, header: Header, frame: Frame, short_range: ShortRange, config: Config) -> None:
        """Publish what was found in a frame."""
        # Occupancy goes first: a long-range node in another process waits for it, and then for its geometry.
        self.occupancy.publish_image(lambda: short_range.occupancy, header)
        self._publish_geometry(header, short_range, frame.camera, n_disparities=config.stereo.n_disparities)
        self._mask.publish_image(lambda: short_range.mask, header)
        self._publish_points(header, short_range, frame.camera, config)
        self._publish_pose(header, frame, short_range)
        self._depth.publish_image(lambda: frame.camera.depth_m(short_range.disparity), header)
        self._u_disparity.publish_image(lambda: short_range.u_disparity, header)
        self._v_disparity.publish_image(lambda: messages.as_uint16(short_range.v_disparity), header)
        self._obstacle_disparity.publish_image(lambda: short_range.obstacle_disparity, header)
        self._rows.look(frame, short_range.disparity)

    def _publish_geometry(
        self, header: Header, short_range: ShortRange, camera: StereoCamera, *, n_disparities: int
    ) -> None:
        """Publish disparity, and that of the ground."""
        if self._disparity is not None:
            self._disparity.publish(
                lambda: messages.disparity_to_message(
                    short_range.disparity, header, camera, n_disparities=n_disparities
                )
            )
        self._ground_disparity.publish(
            lambda: messages.disparity_to_message(
                _ground_disparity(short_range), header, camera, n_disparities=n_disparities
            )
        )

    def _publish_points(self, header: Header, short_range: ShortRange, camera: StereoCamera, config: Config) -> None:
        """Publish obstacles and free ground; also where there are none, so that costmaps see that the sensor lives."""
        disparity, occupancy, line, maps = short_range.disparity, short_range.occupancy, short_range.line, config.maps
        step = config.ground.max_step_m
        self._obstacles.publish(
            lambda: messages.points_to_message(
                obstacle_points(disparity, occupancy, line, camera, maps, least_height_m=step), header
            )
        )
        self._free.publish(lambda: messages.points_to_message(free_points(occupancy, line, camera, maps), header))

    def _publish_pose(self, header: Header, frame: Frame, short_range: ShortRange) -> None:
        """Publish where the camera is over the ground, as far as that is known."""
        if short_range.line is None:
            return
        ground = GroundFrame.of(short_range.line, frame.camera)
        self._transform.publish(ground, header)
        smoothed = self._smoother.add(ground, frame.stamp_ns)
        self._ground_pose.publish(lambda: messages.pose_to_message(smoothed, header))


def _ground_disparity(short_range: ShortRange) -> NDArray[np.float32]:
    """Return the disparity that the ground has in each pixel; 0 everywhere where none was found."""
    shape, line = short_range.disparity.shape, short_range.line
    return np.zeros(shape, np.float32) if line is None else line.disparity(*shape)
