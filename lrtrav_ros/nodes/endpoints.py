"""Publishers and subscriptions with the package's quality of service, which parameters ``qos_overrides.…`` change."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSPolicyKind, QoSProfile, QoSReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header

from lrtrav_ros.nodes.messages import array_to_image

_OVERRIDES = QoSOverridingOptions(
    [QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY]
)


def subscribe(
    node: Node, kind: type[Any], topic: str, callback: Callable[[Any], None], *, depth: int = 5
) -> Subscription:
    """Subscribe as sensor data are: best effort matches every publisher. `depth` messages wait at most."""
    qos = QoSProfile(depth=depth, reliability=QoSReliabilityPolicy.BEST_EFFORT)
    return node.create_subscription(kind, topic, callback, qos, qos_overriding_options=_OVERRIDES)


def subscribe_image(
    node: Node, topic: str, callback: Callable[[Any], None], *, compressed: bool, transport: str = "compressed"
) -> Subscription:
    """Subscribe to an image, or to what image_transport publishes beside it; remapping the image moves both."""
    if not compressed:
        return subscribe(node, Image, topic, callback)
    return subscribe(node, CompressedImage, f"{node.resolve_topic_name(topic)}/{transport}", callback)


def advertise(node: Node, kind: type[Any], topic: str) -> Publisher:
    """Return a reliable publisher of which only the newest message counts."""
    return node.create_publisher(kind, topic, QoSProfile(depth=1), qos_overriding_options=_OVERRIDES)


def publish_if_wanted(publisher: Publisher, header: Header, pixels: Callable[[], NDArray[Any]]) -> None:
    """Publish an image that is made only where somebody subscribes to it."""
    if publisher.get_subscription_count():
        publisher.publish(array_to_image(pixels(), header))
