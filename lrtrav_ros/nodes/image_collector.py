"""Collects the images and grids that nodes publish, by the stamp that they share."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import partial
from types import TracebackType
from typing import Any

import rclpy
from nav_msgs.msg import OccupancyGrid
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Image

from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.io.message_frames import header_stamp_ns
from lrtrav_ros.nodes.messages import message_to_grid
from lrtrav_ros.nodes.shared_memory import IMAGES_PROFILE, use_segment

_QUEUE_DEPTH = 50


class ImageCollector:
    """A node that keeps every image and grid of some topics; to be used in a ``with`` block, alone in its process.

    Parameters
    ----------
    topics : sequence of str
        Relative names; those that end in ``grid`` are of grids.
    namespace : str
        Where they are.

    Attributes
    ----------
    images : dict of int to dict of str to ndarray or Grid
        What came with each stamp in nanoseconds, by topic.
    """

    def __init__(self, topics: Sequence[str], *, namespace: str) -> None:
        use_segment(IMAGES_PROFILE)
        # Signals are those of the command; rclpy would shut ROS down meanwhile, in a thread of its own.
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.images: dict[int, dict[str, Any]] = defaultdict(dict)
        self._node = rclpy.create_node("collector", namespace=namespace)
        self._topics = topics
        qos = QoSProfile(depth=_QUEUE_DEPTH)
        for topic in topics:
            kind = OccupancyGrid if topic.endswith("grid") else Image
            self._node.create_subscription(kind, topic, partial(self._take, topic), qos)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)

    def __enter__(self) -> ImageCollector:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, err: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()

    def n_complete(self) -> int:
        """Number of stamps for which every topic has come."""
        return sum(len(images) == len(self._topics) for images in self.images.values())

    def publishers_are_there(self) -> bool:
        """Return whether somebody publishes each of the topics."""
        return all(self._node.count_publishers(topic) > 0 for topic in self._topics)

    def spin_until(self, done: Callable[[], bool], *, timeout_s: float) -> bool:
        """Take images until `done` or the time is up; return whether it is done."""
        deadline = time.monotonic() + timeout_s
        while not done():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=0.05)
        return True

    def _take(self, topic: str, message: Any) -> None:
        is_grid = isinstance(message, OccupancyGrid)
        self.images[header_stamp_ns(message)][topic] = message_to_grid(message) if is_grid else decode_message(message)
