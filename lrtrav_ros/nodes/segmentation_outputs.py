"""The topics of Nav2's semantic segmentation layer: class, confidence and position of each pixel."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from lrtrav_ros.config import MapsConfig
from lrtrav_ros.detector import LongRange
from lrtrav_ros.mapping.segmentation import (
    CLASSES,
    segmentation_confidence,
    segmentation_mask,
    segmentation_points,
)
from lrtrav_ros.nodes import messages
from lrtrav_ros.nodes.endpoints import Output
from lrtrav_ros.nodes.long_range_inputs import NearGeometry

try:
    from vision_msgs.msg import LabelInfo, VisionClass
except ImportError:  # no wheel has it; a robot's ROS does
    LabelInfo = VisionClass = None


class SegmentationOutputs:
    """The publishers; mask, confidence and points of a frame have one stamp, and go out together.

    Parameters
    ----------
    node : rclpy.node.Node
        Publishes.
    """

    def __init__(self, node: Node) -> None:
        best_effort = QoSReliabilityPolicy.BEST_EFFORT
        self._mask = Output(node, "segmentation/mask", reliability=best_effort)
        self._confidence = Output(node, "segmentation/confidence", reliability=best_effort)
        self._points = Output(node, "segmentation/points", PointCloud2, reliability=best_effort)
        if LabelInfo is not None:
            qos = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
            self._labels = node.create_publisher(LabelInfo, "segmentation/label_info", qos)
            self._labels.publish(_label_info())

    @property
    def is_wanted(self) -> bool:
        """Whether somebody subscribes to what takes the geometry of the short range."""
        return self._points.is_wanted

    def publish(self, header: Header, long_range: LongRange) -> None:
        """Publish the class of each pixel, and how sure it is."""
        occupancy, confidence = long_range.occupancy, long_range.confidence
        self._mask.publish_image(lambda: segmentation_mask(occupancy), header)
        self._confidence.publish_image(lambda: segmentation_confidence(occupancy, confidence), header)

    def publish_points(self, header: Header, long_range: LongRange, geometry: NearGeometry, config: MapsConfig) -> None:
        """Publish where each pixel is."""
        disparity, line, camera = geometry.disparity, geometry.line, geometry.camera
        self._points.publish(
            lambda: messages.points_to_message(
                segmentation_points(long_range.occupancy, disparity, line, camera, config), header
            )
        )


def _label_info() -> LabelInfo:
    """Return the names of the classes."""
    return LabelInfo(
        class_map=[VisionClass(class_id=number, class_name=name) for name, number in CLASSES.items()], threshold=0.0
    )
