"""The three sources of the short-range node: a stereo pair, a disparity image or a depth image."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Protocol

from rclpy.node import Node
from sensor_msgs.msg import CameraInfo

from lrtrav_ros.io.message_frames import FrameMessages
from lrtrav_ros.io.pairing import StampPairing, TopicQueue
from lrtrav_ros.io.serialized_message import SerializedMessage
from lrtrav_ros.io.topics import DEPTH_IMAGE, DISPARITY, LEFT_IMAGE, LEFT_INFO, RIGHT_IMAGE, RIGHT_INFO
from lrtrav_ros.nodes import endpoints
from lrtrav_ros.nodes.parameters import Settings

PATIENCE_S = 5.0
"""Seconds without a frame after which a node says why there is none."""

Deliver = Callable[[FrameMessages], None]


class Input(Protocol):
    """A source of disparity: subscribes, and delivers the messages of each frame, its images still serialised."""

    calibrated: CalibratedFrames

    @property
    def frame_topic(self) -> TopicQueue[SerializedMessage]:
        """The topic whose messages count as frames."""

    def problem(self) -> str:
        """Return why no frames come; empty where they do."""


class CalibratedFrames:
    """Adds the latest CameraInfo to the images of a frame; the newest frame waits until there is one.

    Parameters
    ----------
    node : rclpy.node.Node
        Subscribes to the CameraInfo topics.
    source : str
        What disparity is made from.
    deliver : callable
        Takes the messages of each frame.
    needed, optional : tuple of str
        CameraInfo topics without which no frame is delivered, and one that is added where it is there.

    Attributes
    ----------
    n_replaced : int
        Frames that a newer one replaced while they waited for their calibration.
    """

    def __init__(
        self, node: Node, source: str, deliver: Deliver, *, needed: tuple[str, ...], optional: tuple[str, ...] = ()
    ) -> None:
        self.n_replaced = 0
        self._source = source
        self._deliver = deliver
        self._needed = {name: node.resolve_topic_name(name) for name in needed}
        self._latest: dict[str, CameraInfo] = {}
        self._waiting: tuple[SerializedMessage | None, SerializedMessage] | None = None
        for name in (*needed, *optional):
            endpoints.subscribe_info(node, name, partial(self._take_info, name))

    def put(self, left: SerializedMessage | None, partner: SerializedMessage) -> None:
        """Take the images of a frame; the left one may be None where disparity or depth is the source."""
        self.n_replaced += self._waiting is not None
        self._waiting = (left, partner)
        self._deliver_if_calibrated()

    def problem(self) -> str:
        """Return which calibration a frame waits for; empty where none does."""
        missing = [topic for name, topic in self._needed.items() if name not in self._latest]
        if self._waiting is None or not missing:
            return ""
        return f"no CameraInfo yet on {' and '.join(missing)}; frames wait for it"

    def _take_info(self, name: str, info: CameraInfo) -> None:
        self._latest[name] = info
        self._deliver_if_calibrated()

    def _deliver_if_calibrated(self) -> None:
        if self._waiting is None or any(name not in self._latest for name in self._needed):
            return
        (left, partner), self._waiting = self._waiting, None
        self._deliver(
            FrameMessages(
                source=self._source,
                left=left,
                partner=partner,
                left_info=self._latest[LEFT_INFO],
                right_info=self._latest.get(RIGHT_INFO),
            )
        )


class StereoInput:
    """A rectified pair of images, paired by stamp."""

    def __init__(self, node: Node, settings: Settings, deliver: Deliver, refuse: endpoints.Refuse) -> None:
        self.calibrated = CalibratedFrames(node, "stereo", deliver, needed=(LEFT_INFO, RIGHT_INFO))
        self._settings = settings
        compressed = settings.config.source.compressed
        left = endpoints.subscribe_image(node, LEFT_IMAGE, self._take_left, refuse, compressed=compressed)
        right = endpoints.subscribe_image(node, RIGHT_IMAGE, self._take_right, refuse, compressed=compressed)
        self._pairing: StampPairing[SerializedMessage, SerializedMessage] = StampPairing(
            TopicQueue(left.topic_name), TopicQueue(right.topic_name)
        )

    @property
    def frame_topic(self) -> TopicQueue[SerializedMessage]:
        """The left images."""
        return self._pairing.first

    def problem(self) -> str:
        """Return why no images pair, or what they wait for."""
        if self._pairing.idle_s < PATIENCE_S:
            return self.calibrated.problem()
        return self.calibrated.problem() or self._pairing.silence(tolerance_ns=self._settings.stamp_tolerance_ns)

    def _take_left(self, message: SerializedMessage) -> None:
        self._put(self._pairing.add_first(message.stamp_ns, message, tolerance_ns=self._tolerance_ns))

    def _take_right(self, message: SerializedMessage) -> None:
        self._put(self._pairing.add_second(message.stamp_ns, message, tolerance_ns=self._tolerance_ns))

    @property
    def _tolerance_ns(self) -> int:
        return self._settings.stamp_tolerance_ns

    def _put(self, pair: tuple[SerializedMessage, SerializedMessage] | None) -> None:
        if pair is not None:
            self.calibrated.put(*pair)


class _SingleInput:
    """One message a frame, and the CameraInfo of the left camera."""

    def __init__(self, calibrated: CalibratedFrames) -> None:
        self.calibrated = calibrated
        self.frame_topic: TopicQueue[SerializedMessage] = TopicQueue("")
        self._last_s = time.monotonic()

    def problem(self) -> str:
        """Return that nothing comes, or what it waits for."""
        idle_s = time.monotonic() - self._last_s
        silence = f"no message for {idle_s:.0f} s; {self.frame_topic}" if idle_s >= PATIENCE_S else ""
        return self.calibrated.problem() or silence

    def _take(self, message: SerializedMessage) -> None:
        self._last_s = time.monotonic()
        self.frame_topic.count(message.stamp_ns)
        self.calibrated.put(None, message)


class DisparityInput(_SingleInput):
    """A disparity image from elsewhere, such as ``stereo_image_proc`` or an FPGA."""

    def __init__(self, node: Node, settings: Settings, deliver: Deliver, refuse: endpoints.Refuse) -> None:
        super().__init__(CalibratedFrames(node, "disparity", deliver, needed=(LEFT_INFO,)))
        self.frame_topic.topic = endpoints.subscribe_disparity(node, DISPARITY, self._take, refuse).topic_name


class DepthInput(_SingleInput):
    """A depth image that is registered to the left image."""

    def __init__(self, node: Node, settings: Settings, deliver: Deliver, refuse: endpoints.Refuse) -> None:
        super().__init__(CalibratedFrames(node, "depth", deliver, needed=(LEFT_INFO,), optional=(RIGHT_INFO,)))
        compressed = settings.config.source.compressed
        self.frame_topic.topic = endpoints.subscribe_image(
            node, DEPTH_IMAGE, self._take, refuse, compressed=compressed, transport="compressedDepth"
        ).topic_name


INPUTS: dict[str, Callable[[Node, Settings, Deliver, endpoints.Refuse], Input]] = {
    "stereo": StereoInput,
    "disparity": DisparityInput,
    "depth": DepthInput,
}
