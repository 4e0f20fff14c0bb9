"""The three sources of the short-range node: a stereo pair, a disparity image or a depth image."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from rclpy.node import Node
from rclpy.subscription import Subscription

from lrtrav_ros.io.camera_info import check_calibration
from lrtrav_ros.io.message_frames import FrameMessages
from lrtrav_ros.io.pairing import StampPairing
from lrtrav_ros.io.serialized_message import SerializedMessage
from lrtrav_ros.io.topics import DEPTH_IMAGE, DEPTH_INFO, DISPARITY, LEFT_INFO, RIGHT_INFO, image_inputs
from lrtrav_ros.nodes import endpoints
from lrtrav_ros.nodes.calibration import Calibration
from lrtrav_ros.nodes.counts import Received
from lrtrav_ros.nodes.input_topic import InputTopic, Report
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
    frame_topic: InputTopic

    @property
    def topics(self) -> tuple[InputTopic, ...]:
        """All topics that it subscribes to; the messages of `frame_topic` count as frames."""

    def problem(self) -> str:
        """Return why no frames come; empty where they do."""

    def forget(self) -> None:
        """Forget calibration and counts, and drop what waits."""


def received_by(frames: Input) -> Received:
    """Return what came of the messages of an input before frames of them reached the worker."""
    calibrated = frames.calibrated
    return Received(frames.topics, frames.frame_topic, n_replaced=calibrated.n_replaced, n_waiting=calibrated.n_waiting)


class CalibratedFrames:
    """Adds the latest CameraInfo to the images of a frame; the newest frame waits until there is one.

    Parameters
    ----------
    node : rclpy.node.Node
        Subscribes to the CameraInfo topics.
    source : str
        What disparity is made from.
    deliver, report : callable
        Take the messages of each frame, and why one is refused.
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
        report: Report,
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
        self._waiting: tuple[SerializedMessage | None, SerializedMessage] | None = None
        self._waiting_since_s = 0.0
        self.awaited = AwaitedTopics(node)
        self._calibrations = {name: self._subscribed(node, name, report) for name in (*needed, *optional)}

    def _subscribed(self, node: Node, name: str, report: Report) -> Calibration:
        """Subscribe to a CameraInfo."""
        check = partial(
            check_calibration,
            is_right=name == RIGHT_INFO,
            is_raw=self._is_raw,
            has_focal_length=self._source != "disparity",
        )
        calibration = Calibration(name, report, check)
        topic = calibration.topic
        subscription = endpoints.subscribe_info(node, name, partial(self._take, calibration), topic.refuse_damaged)
        topic.topic = subscription.topic_name
        if name in self._needed:
            self.awaited.add(name, subscription, topic.has_come)
        return calibration

    @property
    def topics(self) -> tuple[InputTopic, ...]:
        """Those of the calibration."""
        return tuple(calibration.topic for calibration in self._calibrations.values())

    @property
    def n_waiting(self) -> int:
        """Frames that wait for their calibration."""
        return int(self._waiting is not None)

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
        self._waiting = None
        self.awaited.forget()
        for calibration in self._calibrations.values():
            calibration.forget()

    def problem(self) -> str:
        """Return which calibration or pose frames have waited for a while; empty where none do."""
        missing = [topic for name, topic in self._needed.items() if self._info(name) is None]
        if self._waiting is None or time.monotonic() - self._waiting_since_s < CALIBRATION_PATIENCE_S:
            return ""
        if missing:
            return f"no CameraInfo yet on {' and '.join(missing)}; frames wait for it"
        return "" if self._depth_pose is None else self._depth_pose.problem

    def _take(self, calibration: Calibration, message: SerializedMessage) -> None:
        if calibration.take(message):
            self._deliver_if_calibrated()

    def _info(self, name: str) -> Any | None:
        """Return the CameraInfo of a topic; None where none has come, or it is not subscribed to."""
        calibration = self._calibrations.get(name)
        return None if calibration is None else calibration.info

    def _deliver_if_calibrated(self) -> None:
        if self._waiting is None or any(self._info(name) is None for name in self._needed):
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
                left_info=self._info(LEFT_INFO),
                right_info=self._info(RIGHT_INFO),
                is_raw=self._is_raw,
                depth_info=self._info(DEPTH_INFO),
                depth_pose=pose,
            )
        )

    def _pose(self) -> Pose | None:
        """Return the depth camera's pose; None where it is not known or not needed."""
        if self._depth_pose is None:
            return None
        return self._depth_pose.of(self._info(LEFT_INFO), self._info(DEPTH_INFO))


class StereoInput:
    """A pair of images, rectified or, with ``source.rectify``, raw; paired by stamp."""

    def __init__(self, node: Node, settings: Settings, deliver: Deliver, report: Report) -> None:
        source = settings.config.source
        self.calibrated = CalibratedFrames(
            node, "stereo", deliver, report, needed=(LEFT_INFO, RIGHT_INFO), is_raw=source.rectify
        )
        self._settings = settings
        left, right = image_inputs("stereo", rectify=source.rectify)
        self.frame_topic = InputTopic(left, report, part="left")
        self._right = InputTopic(right, report, part="partner")
        for topic, take in ((self.frame_topic, self._take_left), (self._right, self._take_right)):
            subscription = endpoints.subscribe_image(
                node, topic.name, take, topic.refuse_damaged, compressed=source.compressed
            )
            topic.topic = subscription.topic_name
            self.calibrated.awaited.add(topic.name, subscription, topic.has_come)
        self._pairing = StampPairing(self.frame_topic.queue, self._right.queue)

    @property
    def topics(self) -> tuple[InputTopic, ...]:
        """The two images and their calibrations."""
        return (self.frame_topic, self._right, *self.calibrated.topics)

    def forget(self) -> None:
        """Forget calibration and counts, and drop what waits."""
        self.calibrated.forget()
        self.frame_topic.forget()
        self._right.forget()
        self._pairing = StampPairing(self.frame_topic.queue, self._right.queue)

    def problem(self) -> str:
        """Return why no images pair, or what they wait for, and what is wrong with topics on which nothing has come."""
        silence = silence_of(self._pairing, self._tolerance_ns, PATIENCE_S)
        return joined(self.calibrated.problem() or silence, self.calibrated.awaited.problem(PATIENCE_S))

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


def silence_of(pairing: StampPairing[Any, Any], tolerance_ns: int, patience_s: float) -> str:
    """Return why nothing has paired for so long [s]; empty where something has, or where no message has come at all."""
    has_begun = pairing.first.received + pairing.second.received > 0
    return pairing.silence(tolerance_ns=tolerance_ns) if has_begun and pairing.idle_s >= patience_s else ""


def joined(*problems: str) -> str:
    """Return what is wrong in lines."""
    return "\n".join(problem for problem in problems if problem)


class _SingleInput:
    """One message a frame, and the CameraInfo of the left camera."""

    def __init__(self, calibrated: CalibratedFrames, frame_topic: InputTopic) -> None:
        self.calibrated = calibrated
        self.frame_topic = frame_topic
        self._last_s = time.monotonic()

    @property
    def topics(self) -> tuple[InputTopic, ...]:
        """The image and its calibration."""
        return (self.frame_topic, *self.calibrated.topics)

    def forget(self) -> None:
        """Forget calibration and counts, and drop what waits."""
        self.calibrated.forget()
        self.frame_topic.forget()

    def problem(self) -> str:
        """Return that nothing comes, or what it waits for, and what is wrong with topics on which nothing has come."""
        return joined(self.calibrated.problem() or self._silence(), self.calibrated.awaited.problem(PATIENCE_S))

    def _silence(self) -> str:
        """Return that no more messages come, where some have."""
        idle_s, queue = time.monotonic() - self._last_s, self.frame_topic.queue
        return f"no message for {idle_s:.0f} s; {queue}" if queue.received > 0 and idle_s >= PATIENCE_S else ""

    def _await(self, subscription: Subscription) -> None:
        """Count the messages of a subscription as frames, and wait for them."""
        self.frame_topic.topic = subscription.topic_name
        self.calibrated.awaited.add(self.frame_topic.name, subscription, self.frame_topic.has_come)

    def _take(self, message: SerializedMessage) -> None:
        self._last_s = time.monotonic()
        self.frame_topic.queue.count(message.stamp_ns)
        self.calibrated.put(None, message)


class DisparityInput(_SingleInput):
    """A disparity image from elsewhere, such as ``stereo_image_proc`` or an FPGA."""

    def __init__(self, node: Node, settings: Settings, deliver: Deliver, report: Report) -> None:
        topic = InputTopic(DISPARITY, report, part="partner")
        super().__init__(CalibratedFrames(node, "disparity", deliver, report, needed=(LEFT_INFO,)), topic)
        self._await(endpoints.subscribe_disparity(node, DISPARITY, self._take, topic.refuse_damaged))


class DepthInput(_SingleInput):
    """A depth image that is registered to the left image, or is to be, with ``source.depth_registered`` false."""

    def __init__(self, node: Node, settings: Settings, deliver: Deliver, report: Report) -> None:
        source = settings.config.source
        calibrated = CalibratedFrames(
            node,
            "depth",
            deliver,
            report,
            needed=(LEFT_INFO,) if source.depth_registered else (LEFT_INFO, DEPTH_INFO),
            optional=(RIGHT_INFO,),
            depth_pose=None if source.depth_registered else DepthPose(node, source.depth_pose),
        )
        topic = InputTopic(DEPTH_IMAGE, report, part="partner")
        super().__init__(calibrated, topic)
        compressed = source.compressed
        self._await(
            endpoints.subscribe_image(
                node, DEPTH_IMAGE, self._take, topic.refuse_damaged, compressed=compressed, transport="compressedDepth"
            )
        )


INPUTS: dict[str, Callable[[Node, Settings, Deliver, Report], Input]] = {
    "stereo": StereoInput,
    "disparity": DisparityInput,
    "depth": DepthInput,
}
