"""Where the long-range node has its frames from: topics, or the short-range node of the same process."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from std_msgs.msg import Header

from lrtrav_ros.frame import Image
from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.io.message_frames import header_stamp_ns
from lrtrav_ros.io.pairing import StampPairing, TopicQueue
from lrtrav_ros.io.serialized_message import SerializedMessage
from lrtrav_ros.io.topics import LEFT_IMAGE
from lrtrav_ros.nodes import endpoints
from lrtrav_ros.nodes.inputs import PATIENCE_S
from lrtrav_ros.nodes.messages import header_of
from lrtrav_ros.nodes.parameters import Settings

_WAITING_LEFT = 30  # one second at 30 Hz: a left image waits while the short-range node works on its frame
_WAITING_OCCUPANCY = 5


@dataclass(frozen=True, slots=True, eq=False)
class LeftImage:
    """A left image, grey or BGR, and its header."""

    header: Header
    pixels: Image

    @property
    def stamp_ns(self) -> int:
        """Its stamp in nanoseconds."""
        return header_stamp_ns(self)


@dataclass(frozen=True, slots=True, eq=False)
class LongRangeFrame:
    """A frame for the long range, whose parts are asked for when their turn comes.

    Attributes
    ----------
    left : callable
        Returns the left image; raises ValueError where it cannot be decoded.
    occupancy : callable
        Returns the short-range occupancy, (H, W) ndarray of uint8, and may wait for it. It raises ValueError where it
        cannot be decoded, and `CancelledError` where the short range fails.
    """

    left: Callable[[], LeftImage]
    occupancy: Callable[[], NDArray[np.uint8]]


Deliver = Callable[[LongRangeFrame], None]


class LongRangeInput(Protocol):
    """Delivers the frames of the long range."""

    @property
    def frame_topic(self) -> TopicQueue[SerializedMessage]:
        """The topic whose messages count as frames."""

    def problem(self) -> str:
        """Return why no frames come; empty where they do."""


class TopicsInput:
    """Left image and occupancy, paired by stamp."""

    def __init__(self, node: Node, settings: Settings, deliver: Deliver, refuse: endpoints.Refuse) -> None:
        self._node = node
        self._settings = settings
        self._deliver = deliver
        compressed = settings.config.source.compressed
        left = endpoints.subscribe_image(node, LEFT_IMAGE, self._take_left, refuse, compressed=compressed)
        occupancy = endpoints.subscribe_image(node, "short_range/occupancy", self._take_occupancy, refuse)
        self._subscriptions = (left, occupancy)
        self._pairing: StampPairing[SerializedMessage, SerializedMessage] = StampPairing(
            TopicQueue(occupancy.topic_name, _WAITING_OCCUPANCY),
            TopicQueue(left.topic_name, _WAITING_LEFT, is_ordered=True),
        )

    @property
    def frame_topic(self) -> TopicQueue[SerializedMessage]:
        """The occupancy."""
        return self._pairing.first

    @property
    def left_topic(self) -> str:
        """Full name of the left image's topic."""
        return self._pairing.second.topic

    def problem(self) -> str:
        """Return why nothing pairs."""
        return "" if self._pairing.idle_s < PATIENCE_S else self._pairing.silence(tolerance_ns=self._tolerance_ns)

    def close(self) -> None:
        """End the subscriptions."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    @property
    def _tolerance_ns(self) -> int:
        """Largest difference of stamps: none for stereo; disparity and depth may have stamps of their own."""
        return 0 if self._settings.config.source.source == "stereo" else self._settings.stamp_tolerance_ns

    def _take_left(self, message: SerializedMessage) -> None:
        self._put(self._pairing.add_second(message.stamp_ns, message, tolerance_ns=self._tolerance_ns))

    def _take_occupancy(self, message: SerializedMessage) -> None:
        self._put(self._pairing.add_first(message.stamp_ns, message, tolerance_ns=self._tolerance_ns))

    def _put(self, pair: tuple[SerializedMessage, SerializedMessage] | None) -> None:
        if pair is None:
            return
        occupancy, left = pair
        self._deliver(LongRangeFrame(lambda: _decode_left(left), lambda: decode_message(occupancy.decode())))


def _decode_left(message: SerializedMessage) -> LeftImage:
    decoded = message.decode()
    return LeftImage(header_of(decoded), decode_message(decoded))


class ShortRangeLink:
    """Frames of the short-range node in the same process, from the moment that it begins with them.

    Parameters
    ----------
    topics : TopicsInput
        What it takes the place of.
    deliver : callable
        Takes each frame.
    """

    def __init__(self, topics: TopicsInput, deliver: Deliver) -> None:
        self.frame_topic: TopicQueue[SerializedMessage] = TopicQueue(topics.frame_topic.topic)
        self._deliver = deliver
        self._last_s = time.monotonic()

    def problem(self) -> str:
        """Return that the short-range node has no frames; why, its own diagnostics tell."""
        idle_s = time.monotonic() - self._last_s
        return f"no frame from the short-range node for {idle_s:.0f} s" if idle_s >= PATIENCE_S else ""

    @contextmanager
    def frame(self, left: LeftImage) -> Iterator[Callable[[NDArray[np.uint8]], None]]:
        """Hand over a left image; yield what takes its occupancy. Without it the frame is given up after the block."""
        self._last_s = time.monotonic()
        self.frame_topic.count(left.stamp_ns)
        occupancy: Future[NDArray[np.uint8]] = Future()
        self._deliver(LongRangeFrame(lambda: left, occupancy.result))
        try:
            yield occupancy.set_result
        finally:
            occupancy.cancel()  # without effect where there is a result
