"""Where the long-range node has its frames from: topics, or the short-range node of the same process."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.frame import Image
from lrtrav_ros.io.camera_info import disparity_camera, unseen_of
from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.io.message_frames import disparity_in_pixels, header_stamp_ns
from lrtrav_ros.io.pairing import StampPairing, TopicQueue
from lrtrav_ros.io.serialized_message import SerializedMessage
from lrtrav_ros.io.topics import DISPARITY, GROUND_DISPARITY, LEFT_IMAGE, LEFT_INFO, OCCUPANCY
from lrtrav_ros.mapping.ground_disparity import ground_line_of
from lrtrav_ros.method.ground import GroundLine
from lrtrav_ros.nodes import endpoints
from lrtrav_ros.nodes.inputs import PATIENCE_S, joined, silence_of
from lrtrav_ros.nodes.messages import header_of
from lrtrav_ros.nodes.missing_topics import AwaitedTopics
from lrtrav_ros.nodes.parameters import Settings

_WAITING_LEFT = 30  # one second at 30 Hz: a left image waits while the short-range node works on its frame
_WAITING_OCCUPANCY = 5
_WAITING_GEOMETRY = 10
_GEOMETRY_TIMEOUT_S = 0.5  # it was published beside the occupancy
_FOLLOWING_PERIOD_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class LeftImage:
    """A left image, grey or BGR, its header, and which of its pixels the camera does not show (see `Frame`)."""

    header: Header
    pixels: Image
    unseen: NDArray[np.bool_] | None = None

    @property
    def stamp_ns(self) -> int:
        """Its stamp in nanoseconds."""
        return header_stamp_ns(self)


@dataclass(frozen=True, slots=True, eq=False)
class NearGeometry:
    """What the short range knows of a frame.

    Attributes
    ----------
    occupancy : (H, W) ndarray of uint8
        0 ground, 100 obstacle, 255 unknown.
    disparity : (H, W) ndarray of float32
        In pixels; 0 for none.
    line : GroundLine or None
        The ground; None where none was found.
    camera : StereoCamera
        Calibration.
    """

    occupancy: NDArray[np.uint8]
    disparity: NDArray[np.float32]
    line: GroundLine | None
    camera: StereoCamera


@dataclass(frozen=True, slots=True, eq=False)
class LongRangeFrame:
    """A frame for the long range, whose parts are asked for when their turn comes.

    Attributes
    ----------
    left : callable
        Returns the left image; raises ValueError where it cannot be decoded, and `CancelledError` where its calibration
        has not come.
    occupancy : callable
        Returns the short-range occupancy, (H, W) ndarray of uint8, and may wait for it. It raises ValueError where it
        cannot be decoded, and `CancelledError` where the short range fails.
    geometry : callable
        Returns the `NearGeometry`, and may wait for it; None where it does not come. It raises ValueError where it
        cannot be decoded.
    """

    left: Callable[[], LeftImage]
    occupancy: Callable[[], NDArray[np.uint8]]
    geometry: Callable[[], NearGeometry | None]


Deliver = Callable[[LongRangeFrame], None]


class LongRangeInput(Protocol):
    """Delivers the frames of the long range."""

    @property
    def frame_topic(self) -> TopicQueue[SerializedMessage]:
        """The topic whose messages count as frames."""

    def problem(self) -> str:
        """Return why no frames come; empty where they do."""

    def forget(self) -> None:
        """Forget calibration and counts."""


@dataclass(frozen=True, slots=True)
class InputTopics:
    """Full names of the topics that the long range has its frames from."""

    left: str
    occupancy: str


def input_topics(node: Node, settings: Settings) -> InputTopics:
    """Return the names that `TopicsInput` subscribes to."""
    transport = "/compressed" if _is_compressed(settings) else ""
    return InputTopics(f"{node.resolve_topic_name(LEFT_IMAGE)}{transport}", node.resolve_topic_name(OCCUPANCY))


def _is_compressed(settings: Settings) -> bool:
    """Return whether left images come compressed: those that the short-range node has rectified do not."""
    source = settings.config.source
    return source.compressed and not source.rectify


class TopicsInput:
    """Left image and occupancy, paired by stamp, and, while maps are wanted, the geometry that belongs to them.

    Parameters
    ----------
    node : rclpy.node.Node
        Subscribes.
    settings : Settings
        Its parameters.
    deliver, refuse : callable
        Take each frame, and what is wrong with a message.
    is_mapped : callable
        Returns whether somebody wants maps.
    """

    def __init__(
        self,
        node: Node,
        settings: Settings,
        deliver: Deliver,
        refuse: endpoints.Refuse,
        *,
        is_mapped: Callable[[], bool],
    ) -> None:
        self._node = node
        self._settings = settings
        self._deliver = deliver
        self._geometry = GeometryTopics(node, refuse, is_wanted=is_mapped)
        self._refuse = refuse
        left = endpoints.subscribe_image(
            node, LEFT_IMAGE, self._take_left, self._refuse_left, compressed=_is_compressed(settings)
        )
        occupancy = endpoints.subscribe_image(node, OCCUPANCY, self._take_occupancy, self._refuse_occupancy)
        self._unseen = UnseenPixels(node) if settings.config.source.rectify else None
        self._subscriptions = (left, occupancy)
        self._pairing = _pairing(left.topic_name, occupancy.topic_name)
        self._awaited = AwaitedTopics(node)
        self._awaited.add(LEFT_IMAGE, left, lambda: self._pairing.second.received > 0)
        self._awaited.add(OCCUPANCY, occupancy, lambda: self._pairing.first.received > 0)

    @property
    def frame_topic(self) -> TopicQueue[SerializedMessage]:
        """The occupancy."""
        return self._pairing.first

    def problem(self) -> str:
        """Return why nothing pairs or there are no maps, and what is wrong with topics on which nothing has come."""
        silence = silence_of(self._pairing, self._tolerance_ns, PATIENCE_S)
        return joined(silence, self._awaited.problem(PATIENCE_S), self._geometry.problem())

    def forget(self) -> None:
        """Forget calibration and counts."""
        self._geometry.forget()
        self._awaited.forget()
        if self._unseen is not None:
            self._unseen.forget()
        self._pairing = _pairing(self._pairing.second.topic, self._pairing.first.topic)

    def close(self) -> None:
        """End the subscriptions."""
        self._geometry.close()
        unseen = () if self._unseen is None else (self._unseen.subscription,)
        for subscription in (*self._subscriptions, *unseen):
            self._node.destroy_subscription(subscription)

    def _decoded(self, left: SerializedMessage) -> LeftImage:
        decoded = left.decode()
        unseen = None if self._unseen is None else self._unseen.now()
        return LeftImage(header_of(decoded), decode_message(decoded), unseen)

    @property
    def _tolerance_ns(self) -> int:
        """Largest difference of stamps: none for stereo; disparity and depth may have stamps of their own."""
        return 0 if self._settings.config.source.source == "stereo" else self._settings.stamp_tolerance_ns

    def _refuse_left(self, err: Exception) -> None:
        self._pairing.second.count_damaged()
        self._refuse(err)

    def _refuse_occupancy(self, err: Exception) -> None:
        self._pairing.first.count_damaged()
        self._refuse(err)

    def _take_left(self, message: SerializedMessage) -> None:
        self._put(self._pairing.add_second(message.stamp_ns, message, tolerance_ns=self._tolerance_ns))

    def _take_occupancy(self, message: SerializedMessage) -> None:
        self._put(self._pairing.add_first(message.stamp_ns, message, tolerance_ns=self._tolerance_ns))

    def _put(self, pair: tuple[SerializedMessage, SerializedMessage] | None) -> None:
        if pair is None:
            return
        occupancy, left = pair
        self._deliver(
            LongRangeFrame(
                lambda: self._decoded(left),
                lambda: decode_message(occupancy.decode()),
                lambda: self._geometry.of(occupancy),
            )
        )


class UnseenPixels:
    """Which pixels of left images that the short-range node rectifies the camera does not show, by its CameraInfo.

    Parameters
    ----------
    node : rclpy.node.Node
        Subscribes.
    """

    def __init__(self, node: Node) -> None:
        self._info: CameraInfo | None = None
        self.subscription = endpoints.subscribe_info(node, LEFT_INFO, self._take)

    def forget(self) -> None:
        """Forget the calibration."""
        self._info = None

    def now(self) -> NDArray[np.bool_] | None:
        """Return them for the newest calibration; raises CancelledError before the first."""
        info = self._info
        if info is None:
            raise CancelledError
        return unseen_of(info)

    def _take(self, info: CameraInfo) -> None:
        self._info = info


def _pairing(left: str, occupancy: str) -> StampPairing[SerializedMessage, SerializedMessage]:
    """Return a pairing of the topics of these names; occupancy comes first."""
    return StampPairing(
        TopicQueue(occupancy, _WAITING_OCCUPANCY, is_ordered=True),
        TopicQueue(left, _WAITING_LEFT, is_ordered=True),
    )


class GeometryTopics:
    """Disparity and ground of the short-range node, subscribed to while they are wanted: they are megabytes a frame.

    Parameters
    ----------
    node : rclpy.node.Node
        Subscribes.
    refuse : callable
        Takes what is wrong with a message.
    is_wanted : callable
        Returns whether somebody wants what is made of them.

    Raises
    ------
    ValueError
        If a QoS override does not fit.
    """

    def __init__(self, node: Node, refuse: endpoints.Refuse, *, is_wanted: Callable[[], bool]) -> None:
        self._node = node
        self._refuse = refuse
        self._is_wanted = is_wanted
        self._messages: dict[str, dict[int, SerializedMessage]] = {DISPARITY: {}, GROUND_DISPARITY: {}}
        self._info: CameraInfo | None = None
        self._changed = threading.Condition()
        self._asked_ns = 0
        self._is_coming = False  # what does not is not waited for: the masks of later frames would wait, too
        self._missing = ""
        self._missing_since_s: float | None = None
        self._subscribe()  # for now in any case: an override that does not fit is found at the start
        # The node's own clock stands still where simulated time does.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_FOLLOWING_PERIOD_S, self._follow, clock=clock)

    def of(self, occupancy: SerializedMessage) -> NearGeometry | None:
        """Return the geometry that an occupancy was found in; None where it does not come in time."""
        stamp_ns = occupancy.stamp_ns
        with self._changed:
            self._asked_ns = stamp_ns
            patience_s = _GEOMETRY_TIMEOUT_S if self._is_coming else 0.0
            self._is_coming = self._changed.wait_for(lambda: self._is_decided(stamp_ns), patience_s)
            self._note_missing(stamp_ns)
            if self._missing:
                return None
            disparity, ground = (_popped(waiting, stamp_ns) for waiting in self._messages.values())
            info = self._info
        message = disparity.decode()
        return NearGeometry(
            decode_message(occupancy.decode()),
            disparity_in_pixels(message),
            ground_line_of(disparity_in_pixels(ground.decode())),
            disparity_camera(message, info),
        )

    def problem(self) -> str:
        """Return why there are no maps; empty where there are some, or nobody wants any."""
        since_s = self._missing_since_s
        if since_s is None or time.monotonic() - since_s < PATIENCE_S:
            return ""
        return joined(self._missing, self._awaited.problem(PATIENCE_S))

    def forget(self) -> None:
        """Forget the calibration and what waits."""
        with self._changed:
            self._info = None
            self._missing_since_s = None
            for waiting in self._messages.values():
                waiting.clear()

    def close(self) -> None:
        """End the subscriptions."""
        self._node.destroy_timer(self._timer)
        self._unsubscribe()

    def _follow(self) -> None:
        """Subscribe where somebody wants maps, and no longer where nobody does."""
        if self._is_wanted() and not self._subscriptions:
            self._subscribe()
        elif not self._is_wanted():
            self._unsubscribe()

    def _subscribe(self) -> None:
        self._subscriptions = {
            LEFT_INFO: endpoints.subscribe_info(self._node, LEFT_INFO, self._take_info),
            **{
                topic: endpoints.subscribe_disparity(self._node, topic, partial(self._take, topic), self._refuse)
                for topic in self._messages
            },
        }
        self._is_coming = True
        self._silent = set(self._subscriptions)
        self._awaited = AwaitedTopics(self._node)
        for topic, subscription in self._subscriptions.items():
            self._awaited.add(topic, subscription, partial(self._has_come, topic))

    def _unsubscribe(self) -> None:
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions = {}
        self._is_coming = False
        self.forget()

    def _has_come(self, topic: str) -> bool:
        return topic not in self._silent

    def _take_info(self, info: CameraInfo) -> None:
        self._silent.discard(LEFT_INFO)
        with self._changed:
            self._info = info
            self._changed.notify_all()

    def _take(self, topic: str, message: SerializedMessage) -> None:
        self._silent.discard(topic)
        stamp_ns = message.stamp_ns
        with self._changed:
            waiting = self._messages[topic]
            waiting.pop(stamp_ns, None)  # it would keep its place
            waiting[stamp_ns] = message
            while len(waiting) > _WAITING_GEOMETRY:
                del waiting[next(iter(waiting))]
            self._is_coming |= stamp_ns == self._asked_ns and not self._absent(stamp_ns)  # a little late
            self._changed.notify_all()

    def _is_decided(self, stamp_ns: int) -> bool:
        """Return whether all of a stamp is there, or something newer is, after which it does not come any more."""
        newest = [next(reversed(waiting)) for waiting in self._messages.values() if waiting and stamp_ns not in waiting]
        return not self._absent(stamp_ns) or any(each > stamp_ns for each in newest)

    def _absent(self, stamp_ns: int) -> list[str]:
        """Return the topics on which nothing with a stamp has come."""
        names = [topic for topic, waiting in self._messages.items() if stamp_ns not in waiting]
        return names + ([] if self._info is not None else [LEFT_INFO])

    def _note_missing(self, stamp_ns: int) -> None:
        """Note what is missing of a stamp, and since when something has been."""
        absent = " and ".join(self._node.resolve_topic_name(name) for name in self._absent(stamp_ns))
        if not absent:
            self._missing, self._missing_since_s = "", None
            return
        self._missing = f"no maps: nothing with the stamp of the occupancy has come on {absent}"
        if self._missing_since_s is None:
            self._missing_since_s = time.monotonic()


def _popped(waiting: dict[int, SerializedMessage], stamp_ns: int) -> SerializedMessage:
    """Remove the message of a stamp, and all that came before it, and return it."""
    stamps = list(waiting)
    for stamp in stamps[: stamps.index(stamp_ns)]:
        del waiting[stamp]
    return waiting.pop(stamp_ns)


class ShortRangeLink:
    """Frames of the short-range node in the same process, from the moment that it begins with them.

    Parameters
    ----------
    topic : str
        Name of the occupancy that it takes the place of.
    deliver : callable
        Takes each frame.
    """

    def __init__(self, topic: str, deliver: Deliver) -> None:
        self.frame_topic: TopicQueue[SerializedMessage] = TopicQueue(topic)
        self._deliver = deliver
        self._last_s = time.monotonic()

    def problem(self) -> str:
        """Return that the short-range node has no frames; why, its own diagnostics tell."""
        idle_s = time.monotonic() - self._last_s
        return f"no frame from the short-range node for {idle_s:.0f} s" if idle_s >= PATIENCE_S else ""

    def forget(self) -> None:
        """Forget the counts, and wait anew from now on."""
        self.frame_topic = TopicQueue(self.frame_topic.topic)
        self._last_s = time.monotonic()

    @contextmanager
    def frame(self, left: LeftImage) -> Iterator[Callable[[NearGeometry], None]]:
        """Hand over a left image; yield what takes its geometry. Without it the frame is given up after the block."""
        self._last_s = time.monotonic()
        self.frame_topic.count(left.stamp_ns)
        geometry: Future[NearGeometry] = Future()
        self._deliver(LongRangeFrame(lambda: left, lambda: geometry.result().occupancy, geometry.result))
        try:
            yield geometry.set_result
        finally:
            geometry.cancel()  # without effect where there is a result
