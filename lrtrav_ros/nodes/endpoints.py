"""Publishers and subscriptions with the package's quality of service, which parameters ``qos_overrides.…`` change."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSDurabilityPolicy, QoSPolicyKind, QoSProfile, QoSReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header
from stereo_msgs.msg import DisparityImage

from lrtrav_ros.io.serialized_message import SerializedMessage
from lrtrav_ros.io.topics import COMPRESSED_TYPE, DISPARITY_TYPE, IMAGE_TYPE, INFO_TYPE
from lrtrav_ros.nodes.messages import array_to_image

_OVERRIDES = QoSOverridingOptions(
    [QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY]
)
_IMAGE_DEPTH = 5

Take = Callable[[SerializedMessage], object]
Refuse = Callable[[Exception], None]


def subscribe_info(node: Node, topic: str, take: Take, refuse: Refuse) -> Subscription:
    """Subscribe to calibration, of which only the newest counts."""
    return _subscribe(node, CameraInfo, INFO_TYPE, topic, take, refuse, depth=1)


def subscribe_image(
    node: Node, topic: str, take: Take, refuse: Refuse, *, compressed: bool = False, transport: str = "compressed"
) -> Subscription:
    """Subscribe to an image, or to what image_transport publishes beside it; remapping the image moves both."""
    if not compressed:
        return _subscribe(node, Image, IMAGE_TYPE, topic, take, refuse)
    topic = f"{node.resolve_topic_name(topic)}/{transport}"
    return _subscribe(node, CompressedImage, COMPRESSED_TYPE, topic, take, refuse)


def subscribe_disparity(node: Node, topic: str, take: Take, refuse: Refuse) -> Subscription:
    """Subscribe to a disparity image."""
    return _subscribe(node, DisparityImage, DISPARITY_TYPE, topic, take, refuse)


def _subscribe(
    node: Node, kind: type[Any], type_name: str, topic: str, take: Take, refuse: Refuse, *, depth: int = _IMAGE_DEPTH
) -> Subscription:
    """Subscribe to messages that stay serialised, `depth` of which wait at most; those that have no stamp are refused.

    Best effort, as sensor data are, matches every publisher. rclpy drops what it cannot decode without a word.
    """

    def take_or_refuse(data: bytes) -> None:
        try:
            message = SerializedMessage(data, type_name)
        except ValueError as err:
            refuse(err)
        else:
            take(message)

    qos = QoSProfile(depth=depth, reliability=QoSReliabilityPolicy.BEST_EFFORT)
    with _refusing_overrides(node, topic):
        return node.create_subscription(kind, topic, take_or_refuse, qos, qos_overriding_options=_OVERRIDES, raw=True)


@contextmanager
def _refusing_overrides(node: Node, topic: str) -> Iterator[None]:
    """Raise ValueError for an override that rclpy cannot use, for which it raises what it does for anything."""
    try:
        yield
    except (RuntimeError, TypeError) as err:  # the second for a depth that C cannot hold
        if not node.context.ok():
            raise
        raise ValueError(f"a parameter qos_overrides.{node.resolve_topic_name(topic)}… does not fit: {err}") from err


class Output:
    """A reliable publisher of which only the newest message counts; what nobody subscribes to is not made.

    Parameters
    ----------
    node : rclpy.node.Node
        Publishes.
    topic : str
        Relative name.
    kind : type, optional
        Class of the messages.
    reliability : QoSReliabilityPolicy, optional
        Best effort where those who subscribe ask for no more.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        kind: type[Any] = Image,
        *,
        reliability: QoSReliabilityPolicy = QoSReliabilityPolicy.RELIABLE,
    ) -> None:
        qos = QoSProfile(depth=1, reliability=reliability)
        with _refusing_overrides(node, topic):
            self._publisher: Publisher = node.create_publisher(kind, topic, qos, qos_overriding_options=_OVERRIDES)
        # An override may keep the newest message for who subscribes later.
        self._is_kept = self._publisher.qos_profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL

    @property
    def topic_name(self) -> str:
        """The full name of the topic."""
        name: str = self._publisher.topic_name
        return name

    @property
    def is_wanted(self) -> bool:
        """Whether somebody subscribes, or may do so later and get the newest message."""
        return self._is_kept or self._publisher.get_subscription_count() > 0

    def publish(self, message: Callable[[], Any]) -> None:
        """Publish a message, which is made only where it is wanted."""
        if self.is_wanted:
            self._publisher.publish(message())

    def publish_image(self, pixels: Callable[[], NDArray[Any]], header: Header) -> None:
        """Publish an image, which is made only where it is wanted."""
        self.publish(lambda: array_to_image(pixels(), header))
