"""The three sources of the short-range node: a stereo pair, a disparity image or a depth image."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo

from lrtrav_ros.io.message_frames import FrameMessages
from lrtrav_ros.io.pairing import StampPairing, TopicQueue
from lrtrav_ros.io.serialized_message import SerializedMessage
from lrtrav_ros.io.topics import DEPTH_IMAGE, DEPTH_INFO, DISPARITY, LEFT_INFO, RIGHT_INFO, image_inputs
from lrtrav_ros.nodes import endpoints
from lrtrav_ros.nodes.missing_topics import AwaitedTopics
from lrtrav_ros.nodes.parameters import Settings
from lrtrav_ros.nodes.transforms import DepthPose
from lrtrav_ros.pose import Pose

PATIENCE_S = 5.0
"""Seconds without a frame after which a node says why there is none."""

CALIBRATION_PATIENCE_S = 2.0
"""Seconds that a frame waits for its calibration before the node says so: some drivers publish it once a second."""

Deliver = Callable[[FrameMessages], None]


class Input(Protocol):
    """A source of disparity: subscribes, and delivers the messages of each frame, its images still serialised."""

    calibrated: CalibratedFrames

    @property
    def frame_topic(self) -> TopicQueue[SerializedMessage]:
        """The topic whose messages count as frames."""

    def problem(self) -> str:
        """Return why no frames come; empty where they do."""

    def forget(self) -> None:
        """Forget calibration and counts, and drop what waits."""


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
    is_raw : bool
        Whether images are to be rectified.
    depth_pose : DepthPose, optional
        Where the depth camera is, without which no frame is delivered where it is given.

    Attributes
    ----------
    n_replaced : int
        Frames that a newer one replaced while they waited for their calibration.
    awaited : AwaitedTopics
        The topics that a frame needs; inputs add theirs.
    """

    def __init__(
        self,
        node: Node,
        source: str,
        deliver: Deliver,
        *,
        needed: tuple[str, ...],
        optional: tuple[str, ...] = (),
        is_raw: bool = False,
        depth_pose: DepthPose | None = None,
    ) -> None:
        self.n_replaced = 0
        self._depth_pose = depth_pose
        self._source = source
        self._is_raw = is_raw
        self._deliver = deliver
        self._needed = {name: node.resolve_topic_name(name) for name in needed}
        self._latest: dict[str, CameraInfo] = {}
        self._waiting: tuple[SerializedMessage | None, SerializedMessage] | None = None
        self._waiting_since_s = 0.0
        self.awaited = AwaitedTopics(node)
        for name in (*needed, *optional):
            subscription = endpoints.subscribe_info(node, name, partial(self._take_info, name))
            if name in needed:
                self.awaited.add(name, subscription, partial(self._has_come, name))

    def put(self, left: SerializedMessage | None, partner: SerializedMessage) -> None:
        """Take the images of a frame; the left one may be None where disparity or depth is the source."""
        self.n_replaced += self._waiting is not None
        if self._waiting is None:
            self._waiting_since_s = time.monotonic()
        self._waiting = (left, partner)
        self._deliver_if_calibrated()

    def forget(self) -> None:
        """Forget the calibration and the count, and drop what waits for it."""
        self.n_replaced = 0
        self._latest.clear()
        self._waiting = None
        self.awaited.forget()

    def problem(self) -> str:
        """Return which calibration or pose frames have waited for a while; empty where none do."""
        missing = [topic for name, topic in self._needed.items() if name not in self._latest]
        if self._waiting is None or time.monotonic() - self._waiting_since_s < CALIBRATION_PATIENCE_S:
            return ""
        if missing:
            return f"no CameraInfo yet on {' and '.join(missing)}; frames wait for it"
        return "" if self._depth_pose is None else self._depth_pose.problem

    def _has_come(self, name: str) -> bool:
        return name in self._latest

    def _take_info(self, name: str, info: CameraInfo) -> None:
        self._latest[name] = info
        self._deliver_if_calibrated()

    def _deliver_if_calibrated(self) -> None:
        if self._waiting is None or any(name not in self._latest for name in self._needed):
            return
        pose = self._pose()
        if self._depth_pose is not None and pose is None:
            return
        (left, partner), self._waiting = self._waiting, None
        self._deliver(
            FrameMessages(
                source=self._source,
                left=left,
                partner=partner,
                left_info=self._latest[LEFT_INFO],
                right_info=self._latest.get(RIGHT_INFO),
                is_raw=self._is_raw,
                depth_info=self._latest.get(DEPTH_INFO),
                depth_pose=pose,
            )
        )

    def _pose(self) -> Pose | None:
        """Return the depth camera's pose; None where it is not known or not needed."""
        if self._depth_pose is None:
            return None
        return self._depth_pose.of(self._latest[LEFT_INFO], self._latest[DEPTH_INFO])


class StereoInput:
    """A pair of images, rectified or, with ``source.rectify``, raw; paired by stamp."""

    def __init__(self, node: Node, settings: Settings, deliver: Deliver, refuse: endpoints.Refuse) -> None:
        source = settings.config.source
        self.calibrated = CalibratedFrames(
            node, "stereo", deliver, needed=(LEFT_INFO, RIGHT_INFO), is_raw=source.rectify
        )
        self._settings = settings
        self._refuse = refuse
        compressed = source.compressed
        left_name, right_name = image_inputs("stereo", rectify=source.rectify)
        left = endpoints.subscribe_image(node, left_name, self._take_left, self._refuse_left, compressed=compressed)
        right = endpoints.subscribe_image(node, right_name, self._take_right, self._refuse_right, compressed=compressed)
        self._pairing = _pairing(left.topic_name, right.topic_name)
        self.calibrated.awaited.add(left_name, left, lambda: self._pairing.first.received > 0)
        self.calibrated.awaited.add(right_name, right, lambda: self._pairing.second.received > 0)

    @property
    def frame_topic(self) -> TopicQueue[SerializedMessage]:
        """The left images."""
        return self._pairing.first

    def forget(self) -> None:
        """Forget calibration and counts, and drop what waits."""
        self.calibrated.forget()
        self._pairing = _pairing(self._pairing.first.topic, self._pairing.second.topic)

    def problem(self) -> str:
        """Return why no images pair, or what they wait for, and what is wrong with topics on which nothing has come."""
        silence = silence_of(self._pairing, self._tolerance_ns, PATIENCE_S)
        return joined(self.calibrated.problem() or silence, self.calibrated.awaited.problem(PATIENCE_S))

    def _refuse_left(self, err: Exception) -> None:
        self._pairing.first.count_damaged()
        self._refuse(err)

    def _refuse_right(self, err: Exception) -> None:
        self._pairing.second.count_damaged()
        self._refuse(err)

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


def _pairing(left: str, right: str) -> StampPairing[SerializedMessage, SerializedMessage]:
    """Return a pairing of the topics of these names."""
    # Late images are not wanted: a pair of theirs would take the place of a newer frame.
    return StampPairing(TopicQueue(left, is_ordered=True), TopicQueue(right, is_ordered=True))


def silence_of(pairing: StampPairing[Any, Any], tolerance_ns: int, patience_s: float) -> str:
    """Return why nothing has paired for so long [s]; empty where something has, or where no message has come at all."""
    has_begun = pairing.first.received + pairing.second.received > 0
    return pairing.silence(tolerance_ns=tolerance_ns) if has_begun and pairing.idle_s >= patience_s else ""


def joined(*problems: str) -> str:
    """Return what is wrong in lines."""
    return "\n".join(problem for problem in problems if problem)


class _SingleInput:
    """One message a frame, and the CameraInfo of the left camera."""

    def __init__(self, calibrated: CalibratedFrames, refuse: endpoints.Refuse) -> None:
        self.calibrated = calibrated
        self._refuse = refuse
        self.frame_topic: TopicQueue[SerializedMessage] = TopicQueue("")
        self._last_s = time.monotonic()

    def forget(self) -> None:
        """Forget calibration and counts, and drop what waits."""
        self.calibrated.forget()
        self.frame_topic = TopicQueue(self.frame_topic.topic)

    def problem(self) -> str:
        """Return that nothing comes, or what it waits for, and what is wrong with topics on which nothing has come."""
        return joined(self.calibrated.problem() or self._silence(), self.calibrated.awaited.problem(PATIENCE_S))

    def _silence(self) -> str:
        """Return that no more messages come, where some have."""
        idle_s = time.monotonic() - self._last_s
        has_ended = self.frame_topic.received > 0 and idle_s >= PATIENCE_S
        return f"no message for {idle_s:.0f} s; {self.frame_topic}" if has_ended else ""

    def _await(self, name: str, subscription: Subscription) -> None:
        """Count the messages of a subscription as frames, and wait for them."""
        self.frame_topic.topic = subscription.topic_name
        self.calibrated.awaited.add(name, subscription, lambda: self.frame_topic.received > 0)

    def _refuse_frame(self, err: Exception) -> None:
        self.frame_topic.count_damaged()
        self._refuse(err)

    def _take(self, message: SerializedMessage) -> None:
        self._last_s = time.monotonic()
        self.frame_topic.count(message.stamp_ns)
        self.calibrated.put(None, message)


class DisparityInput(_SingleInput):
    """A disparity image from elsewhere, such as ``stereo_image_proc`` or an FPGA."""

    def __init__(self, node: Node, settings: Settings, deliver: Deliver, refuse: endpoints.Refuse) -> None:
        super().__init__(CalibratedFrames(node, "disparity", deliver, needed=(LEFT_INFO,)), refuse)
        self._await(DISPARITY, endpoints.subscribe_disparity(node, DISPARITY, self._take, self._refuse_frame))


class DepthInput(_SingleInput):
    """A depth image that is registered to the left image, or is to be, with ``source.depth_registered`` false."""

    def __init__(self, node: Node, settings: Settings, deliver: Deliver, refuse: endpoints.Refuse) -> None:
        source = settings.config.source
        calibrated = CalibratedFrames(
            node,
            "depth",
            deliver,
            needed=(LEFT_INFO,) if source.depth_registered else (LEFT_INFO, DEPTH_INFO),
            optional=(RIGHT_INFO,),
            depth_pose=None if source.depth_registered else DepthPose(node, source.depth_pose),
        )
        super().__init__(calibrated, refuse)
        compressed = source.compressed
        subscription = endpoints.subscribe_image(
            node, DEPTH_IMAGE, self._take, self._refuse_frame, compressed=compressed, transport="compressedDepth"
        )
        self._await(DEPTH_IMAGE, subscription)


INPUTS: dict[str, Callable[[Node, Settings, Deliver, endpoints.Refuse], Input]] = {
    "stereo": StereoInput,
    "disparity": DisparityInput,
    "depth": DepthInput,
}
