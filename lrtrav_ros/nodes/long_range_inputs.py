"""Where the long-range node has its frames from: topics, or the short-range node of the same process."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.subscription import Subscription
from std_msgs.msg import Header

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.frame import Image
from lrtrav_ros.io.camera_info import check_calibration, disparity_camera, unseen_of
from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.io.message_frames import PartError, blaming, disparity_in_pixels, header_stamp_ns
from lrtrav_ros.io.pairing import StampPairing
from lrtrav_ros.io.serialized_message import SerializedMessage
from lrtrav_ros.io.topics import DISPARITY, GROUND_DISPARITY, LEFT_IMAGE, LEFT_INFO, OCCUPANCY
from lrtrav_ros.mapping.ground_disparity import ground_line_of
from lrtrav_ros.method.ground import GroundLine
from lrtrav_ros.nodes import endpoints
from lrtrav_ros.nodes.calibration import Calibration
from lrtrav_ros.nodes.input_topic import InputTopic, Report
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
    def frame_topic(self) -> InputTopic | None:
        """The topic whose messages count as frames; None where they come without."""

    @property
    def topics(self) -> tuple[InputTopic, ...]:
        """All topics that it subscribes to."""

    def problem(self) -> str:
        """Return why no frames come; empty where they do."""

    def forget(self) -> None:
        """Forget calibration and counts."""

    def give_up(self) -> None:
        """Wait for nothing any more."""


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
    deliver, report : callable
        Take each frame, and why a message is refused.
    is_mapped : callable
        Returns whether somebody wants maps.
    """

    def __init__(
        self,
        node: Node,
        settings: Settings,
        deliver: Deliver,
        report: Report,
        *,
        is_mapped: Callable[[], bool],
    ) -> None:
        self._node = node
        self._settings = settings
        self._deliver = deliver
        self._geometry = GeometryTopics(node, report, is_wanted=is_mapped)
        self._awaited = AwaitedTopics(node)
        self.frame_topic = InputTopic(OCCUPANCY, report, capacity=_WAITING_OCCUPANCY, part="partner")
        # Left images of frames that the short range drops find none.
        self._left = InputTopic(LEFT_IMAGE, report, capacity=_WAITING_LEFT, part="left", needs_partner=False)
        self._subscriptions = (
            self._subscribed(self._left, self._take_left, compressed=_is_compressed(settings)),
            self._subscribed(self.frame_topic, self._take_occupancy),
        )
        self._unseen = UnseenPixels(node, report) if settings.config.source.rectify else None
        self._pairing = StampPairing(self.frame_topic.queue, self._left.queue)

    def _subscribed(self, topic: InputTopic, take: endpoints.Take, *, compressed: bool = False) -> Subscription:
        """Subscribe to an image."""
        subscription = endpoints.subscribe_image(
            self._node, topic.name, take, topic.refuse_damaged, compressed=compressed
        )
        topic.topic = subscription.topic_name
        self._awaited.add(topic.name, subscription, topic.has_come)
        return subscription

    @property
    def topics(self) -> tuple[InputTopic, ...]:
        """The two images, and, while maps are wanted, their geometry."""
        unseen = () if self._unseen is None else (self._unseen.topic,)
        return (self._left, self.frame_topic, *self._geometry.topics, *unseen)

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
        self.frame_topic.forget()
        self._left.forget()
        self._pairing = StampPairing(self.frame_topic.queue, self._left.queue)

    def give_up(self) -> None:
        """Wait for nothing any more."""
        self._geometry.give_up()

    def close(self) -> None:
        """End the subscriptions."""
        self._geometry.close()
        unseen = () if self._unseen is None else (self._unseen.subscription,)
        for subscription in (*self._subscriptions, *unseen):
            self._node.destroy_subscription(subscription)

    def _decoded(self, left: SerializedMessage, max_pixels: int) -> LeftImage:
        with blaming("left"):
            decoded = left.decode()
            pixels = decode_message(decoded, max_pixels=max_pixels)
        unseen = None if self._unseen is None else self._unseen.now(pixels.shape)
        return LeftImage(header_of(decoded), pixels, unseen)

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
        (occupancy, left), max_pixels = pair, self._settings.config.source.max_pixels
        self._deliver(
            LongRangeFrame(
                lambda: self._decoded(left, max_pixels),
                lambda: _occupancy_of(occupancy, max_pixels),
                lambda: self._geometry.of(occupancy, max_pixels),
            )
        )


def _occupancy_of(message: SerializedMessage, max_pixels: int) -> NDArray[np.uint8]:
    """Return the occupancy of a message; raises PartError where it holds none."""
    with blaming("partner"):
        occupancy = decode_message(message.decode(), max_pixels=max_pixels)
        if occupancy.ndim != 2 or occupancy.dtype != np.uint8:
            raise ValueError(f"occupancy has shape {occupancy.shape} and type {occupancy.dtype}; give mono8")
        return occupancy


class UnseenPixels:
    """Which pixels of left images that the short-range node rectifies the camera does not show, by its CameraInfo.

    Parameters
    ----------
    node : rclpy.node.Node
        Subscribes.
    report : callable
        Takes why a message is refused.
    """

    def __init__(self, node: Node, report: Report) -> None:
        self._calibration = Calibration(LEFT_INFO, report, partial(check_calibration, is_raw=True))
        self.topic = self._calibration.topic
        self.topic.name = f"{LEFT_INFO} (raw)"  # beside that of the geometry, which counts for itself
        self.subscription = endpoints.subscribe_info(node, LEFT_INFO, self._calibration.take, self.topic.refuse_damaged)
        self.topic.topic = self.subscription.topic_name

    def forget(self) -> None:
        """Forget the calibration."""
        self._calibration.forget()

    def now(self, shape: tuple[int, ...]) -> NDArray[np.bool_] | None:
        """Return those of an image for the newest calibration; raises CancelledError before the first."""
        info = self._calibration.info
        if info is None:
            raise CancelledError
        return unseen_of(info, shape)


class GeometryTopics:
    """Disparity and ground of the short-range node, subscribed to while they are wanted: they are megabytes a frame.

    Parameters
    ----------
    node : rclpy.node.Node
        Subscribes.
    report : callable
        Takes why a message is refused.
    is_wanted : callable
        Returns whether somebody wants what is made of them.

    Raises
    ------
    ValueError
        If a QoS override does not fit.
    """

    def __init__(self, node: Node, report: Report, *, is_wanted: Callable[[], bool]) -> None:
        self._node = node
        self._calibration = Calibration(LEFT_INFO, report, partial(check_calibration, has_focal_length=False))
        self._topics = {name: InputTopic(name, report) for name in (DISPARITY, GROUND_DISPARITY)}
        self._topics[LEFT_INFO] = self._calibration.topic
        self._is_wanted = is_wanted
        self._messages: dict[str, dict[int, SerializedMessage]] = {DISPARITY: {}, GROUND_DISPARITY: {}}
        self._changed = threading.Condition()
        self._asked_ns = 0
        self._n_forgotten = 0
        self._is_given_up = False
        self._is_coming = False  # what does not is not waited for: the masks of later frames would wait, too
        self._missing = ""
        self._missing_since_s: float | None = None
        self._subscribe()  # for now in any case: an override that does not fit is found at the start
        # The node's own clock stands still where simulated time does.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_FOLLOWING_PERIOD_S, self._follow, clock=clock)

    def of(self, occupancy: SerializedMessage, max_pixels: int) -> NearGeometry | None:
        """Return the geometry that an occupancy was found in; None where it does not come in time."""
        stamp_ns = occupancy.stamp_ns
        with self._changed:
            self._asked_ns = stamp_ns
            patience_s = _GEOMETRY_TIMEOUT_S if self._is_coming else 0.0
            is_over = self._changed.wait_for(lambda: self._is_decided(stamp_ns) or self._is_given_up, patience_s)
            self._is_coming = is_over
            self._note_missing(stamp_ns)
            if self._missing:
                return None
            disparity, ground = (_popped(waiting, stamp_ns) for waiting in self._messages.values())
            info, n_forgotten = self._calibration.info, self._n_forgotten
        try:
            return _geometry_of(_occupancy_of(occupancy, max_pixels), disparity, ground, info, max_pixels)
        except PartError as err:  # the masks are out, and there are no maps
            with self._changed:
                if n_forgotten == self._n_forgotten:  # else it is not among those received any more
                    self._topics[err.part].refuse(err)
            return None

    @property
    def topics(self) -> tuple[InputTopic, ...]:
        """What is subscribed to."""
        return tuple(self._topics.values()) if self._subscriptions else ()

    def problem(self) -> str:
        """Return why there are no maps; empty where there are some, or nobody wants any."""
        since_s = self._missing_since_s
        if since_s is None or time.monotonic() - since_s < PATIENCE_S:
            return ""
        return joined(self._missing, self._awaited.problem(PATIENCE_S))

    def forget(self) -> None:
        """Forget the calibration and what waits."""
        with self._changed:
            self._n_forgotten += 1
            self._missing_since_s = None
            self._calibration.forget()
            for name, waiting in self._messages.items():
                waiting.clear()
                self._topics[name].forget()

    def give_up(self) -> None:
        """Wait for nothing any more."""
        with self._changed:
            self._is_given_up = True
            self._changed.notify_all()

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
        refuse = {name: topic.refuse_damaged for name, topic in self._topics.items()}
        self._subscriptions = {
            name: endpoints.subscribe_disparity(self._node, name, partial(self._take, name), refuse[name])
            for name in self._messages
        }
        self._subscriptions[LEFT_INFO] = endpoints.subscribe_info(
            self._node, LEFT_INFO, self._take_info, refuse[LEFT_INFO]
        )
        self._is_coming = True
        self._awaited = AwaitedTopics(self._node)
        for name, topic in self._topics.items():
            topic.topic = self._subscriptions[name].topic_name
            self._awaited.add(name, self._subscriptions[name], topic.has_come)

    def _unsubscribe(self) -> None:
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions = {}
        self._is_coming = False
        self.forget()

    def _take_info(self, message: SerializedMessage) -> None:
        with self._changed:
            if self._calibration.take(message):
                self._changed.notify_all()

    def _take(self, name: str, message: SerializedMessage) -> None:
        stamp_ns = message.stamp_ns
        self._topics[name].queue.count(stamp_ns)
        with self._changed:
            waiting = self._messages[name]
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
        return names + ([] if self._calibration.info is not None else [LEFT_INFO])

    def _note_missing(self, stamp_ns: int) -> None:
        """Note what is missing of a stamp, and since when something has been."""
        absent = " and ".join(self._node.resolve_topic_name(name) for name in self._absent(stamp_ns))
        if not absent:
            self._missing, self._missing_since_s = "", None
            return
        self._missing = f"no maps: nothing with the stamp of the occupancy has come on {absent}"
        if self._missing_since_s is None:
            self._missing_since_s = time.monotonic()


def _geometry_of(
    occupancy: NDArray[np.uint8],
    disparity: SerializedMessage,
    ground: SerializedMessage,
    info: Any,
    max_pixels: int,
) -> NearGeometry:
    """Return the geometry that messages hold; raises PartError, by the name of the topic, where one does not fit."""
    with blaming(DISPARITY):
        message = disparity.decode()
        disparity_px = _of_size(occupancy, disparity_in_pixels(message, max_pixels=max_pixels))
        camera = disparity_camera(message, info)
    with blaming(GROUND_DISPARITY):
        pixels = disparity_in_pixels(ground.decode(), max_pixels=max_pixels)
        line = ground_line_of(_of_size(occupancy, pixels))
    return NearGeometry(occupancy, disparity_px, line, camera)


def _of_size(occupancy: NDArray[np.uint8], disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a disparity; raises ValueError where it has another size than the occupancy."""
    if disparity.shape != occupancy.shape:
        (h, w), (occupancy_h, occupancy_w) = disparity.shape, occupancy.shape
        raise ValueError(f"disparity is {w} x {h} pixels, but the occupancy is {occupancy_w} x {occupancy_h}")
    return disparity


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
    deliver : callable
        Takes each frame.
    """

    frame_topic: InputTopic | None = None
    topics: tuple[InputTopic, ...] = ()

    def __init__(self, deliver: Deliver) -> None:
        self._deliver = deliver
        self._last_s = time.monotonic()

    def problem(self) -> str:
        """Return that the short-range node has no frames; why, its own diagnostics tell."""
        idle_s = time.monotonic() - self._last_s
        return f"no frame from the short-range node for {idle_s:.0f} s" if idle_s >= PATIENCE_S else ""

    def forget(self) -> None:
        """Wait anew from now on."""
        self._last_s = time.monotonic()

    def give_up(self) -> None:
        """Do nothing: the short range answers, or gives up, by itself."""

    @contextmanager
    def frame(self, left: LeftImage) -> Iterator[Callable[[NearGeometry], None]]:
        """Hand over a left image; yield what takes its geometry. Without it the frame is given up after the block."""
        self._last_s = time.monotonic()
        geometry: Future[NearGeometry] = Future()
        self._deliver(LongRangeFrame(lambda: left, lambda: geometry.result().occupancy, geometry.result))
        try:
            yield geometry.set_result
        finally:
            geometry.cancel()  # without effect where there is a result
