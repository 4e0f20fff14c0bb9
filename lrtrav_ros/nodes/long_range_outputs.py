"""What the long-range node publishes of a frame."""

from __future__ import annotations

import math

import numpy as np
from nav_msgs.msg import OccupancyGrid
from numpy.typing import NDArray
from rclpy.node import Node
from std_msgs.msg import Header

from lrtrav_ros.config import MapsConfig
from lrtrav_ros.detector import LongRange
from lrtrav_ros.io.message_frames import stamp_to_ns
from lrtrav_ros.io.pictures import overlay
from lrtrav_ros.mapping.grid import Grid, ground_grid
from lrtrav_ros.mapping.ground_frame import GroundFrame, ground_frame_id
from lrtrav_ros.method.ground import NO_GROUND
from lrtrav_ros.nodes import messages
from lrtrav_ros.nodes.endpoints import Output
from lrtrav_ros.nodes.long_range_inputs import NearGeometry
from lrtrav_ros.nodes.segmentation_outputs import SegmentationOutputs
from lrtrav_ros.nodes.transforms import TransformLookup


class LongRangeOutputs:
    """The publishers of the long-range node.

    Parameters
    ----------
    node : rclpy.node.Node
        Publishes.
    config : MapsConfig
        Where the grid is to be in another frame than that below the camera, the node listens to tf.
    """

    def __init__(self, node: Node, config: MapsConfig) -> None:
        self._mask = Output(node, "long_range/mask")
        self._occupancy = Output(node, "long_range/occupancy")
        self._superpixels = Output(node, "long_range/superpixels")
        self._clusters = Output(node, "long_range/clusters")
        self._confidence = Output(node, "long_range/confidence")
        self._overlay = Output(node, "long_range/overlay")
        self._grid = Output(node, "long_range/grid", OccupancyGrid)
        self._segmentation = SegmentationOutputs(node)
        self._transforms = TransformLookup(node) if config.frame else None
        self._problem = ""

    @property
    def are_mapped(self) -> bool:
        """Whether somebody wants what takes the geometry of the short range."""
        return self._grid.is_wanted or self._segmentation.is_wanted

    def problem(self) -> str:
        """Return why there is no grid; empty where there is one, or nobody wants it."""
        return self._problem if self._grid.is_wanted else ""

    def publish(
        self, header: Header, image: NDArray[np.uint8], occupancy: NDArray[np.uint8], long_range: LongRange
    ) -> None:
        """Publish what was found in the image."""
        self._mask.publish_image(lambda: long_range.mask, header)
        self._occupancy.publish_image(lambda: long_range.occupancy, header)
        self._superpixels.publish_image(lambda: messages.as_uint16(long_range.superpixels), header)
        self._clusters.publish_image(lambda: messages.as_uint16(long_range.clusters), header)
        confidence = long_range.confidence
        if confidence is not None:
            self._confidence.publish_image(lambda: confidence, header)
        self._overlay.publish_image(lambda: overlay(image, occupancy, long_range.occupancy), header)
        self._segmentation.publish(header, long_range)

    def publish_maps(self, header: Header, long_range: LongRange, geometry: NearGeometry, config: MapsConfig) -> None:
        """Publish it in metres."""
        self._segmentation.publish_points(header, long_range, geometry, config)
        if self._grid.is_wanted:
            grid = ground_grid(long_range.occupancy, geometry, geometry.camera, config)
            self._problem = self._publish_grid(header, grid, geometry, config.frame)

    def _publish_grid(self, header: Header, grid: Grid, geometry: NearGeometry, frame: str) -> str:
        """Publish a grid in a frame, or else that below the camera; return why that cannot be done."""
        if self._transforms is None:
            self._grid.publish(lambda: messages.grid_to_message(grid, header, ground_frame_id(header.frame_id)))
            return ""
        if geometry.line is None:
            return f"no grid in {frame}: {NO_GROUND}"
        camera = self._transforms.pose(frame, header.frame_id, stamp_ns=stamp_to_ns(header.stamp))
        if camera is None:
            return f"no grid in {frame}: {self._transforms.problem}"
        ground = camera @ GroundFrame.of(geometry.line, geometry.camera).pose_in_camera
        x, y = ground.translation_m[:2].tolist()
        yaw = math.atan2(ground.rotation[1, 0], ground.rotation[0, 0])
        self._grid.publish(lambda: messages.grid_to_message(grid.in_frame(x, y, yaw), header, frame))
        return ""
