"""Publishing a rosbag's messages in the bag's own timing."""

from __future__ import annotations

import importlib
import math
import os
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from tqdm import tqdm

from lrtrav_ros.io import topics
from lrtrav_ros.io.bag_reader import BagReader
from lrtrav_ros.nodes.ros_shutdown import ros_shut_down
from lrtrav_ros.nodes.shared_memory import IMAGES_PROFILE, use_segment

_IMAGES = frozenset((topics.LEFT_IMAGE, *topics.PARTNER.values(), topics.LEFT_RAW, topics.RIGHT_RAW))
_INPUTS = _IMAGES | {topics.LEFT_INFO, topics.RIGHT_INFO, topics.DEPTH_INFO}
_QUEUE_DEPTH = 10
_LONG_GAP_S = 60.0
_STEP_S = 0.02  # longest sleep: the clock goes on, and a signal is noticed
_SILENT_S = 4.0  # discovery takes up to three seconds; do not report waiting earlier
_SETTLE_S = 0.2  # a subscriber that is known may not know the publisher yet, and would miss the first message
_ACKNOWLEDGED_S = 5.0
_BAR = "{percentage:3.0f} %|{bar}| {n:.1f}/{total:.1f} s"


class RosArgumentsError(ValueError):
    """An argument for ROS, or the name of a topic, is wrong."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayOptions:
    """Settings of a replay.

    Parameters
    ----------
    source : str
        What the detector works on, where the bag holds several: ``stereo``, ``disparity`` or ``depth``.
    raw : bool
        Publish the raw images of stereo pairs as such, for nodes that rectify.
    rate : float
        Factor on the speed, above 0.
    loop : bool
        Start over at the end, until interrupted.
    start_s, duration_s : float
        Part of the bag, in seconds from its start; all of it by default.
    remap : mapping of str to str
        Topic to publish on, for topics of the bag; where it is a name that the detector expects, such as
        ``left/image_rect``, the bag's topic takes that part.
    all_topics : bool
        Publish all other topics of the bag too.
    clock : bool
        Publish ``/clock``.
    wait : bool
        Begin only when the images are subscribed to.
    """

    source: str = "stereo"
    raw: bool = False
    rate: float = 1.0
    loop: bool = False
    start_s: float = 0.0
    duration_s: float | None = None
    remap: Mapping[str, str] = field(default_factory=dict)
    all_topics: bool = False
    clock: bool = False
    wait: bool = True

    def __post_init__(self) -> None:
        if not 0 < self.rate < math.inf:
            raise ValueError(f"rate is {self.rate:g}; give a number above 0")
        if not 0 <= self.start_s < math.inf or (self.duration_s is not None and not 0 < self.duration_s < math.inf):
            raise ValueError(f"start is {self.start_s:g}, duration {self.duration_s}; give seconds above 0")


def replay(path: str | os.PathLike[str], options: ReplayOptions, *, ros_args: Sequence[str] = ()) -> bool:
    """Publish the messages of a bag until its end, or until a signal; return whether all of it could be read.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such bag, or nothing in it that could be published.
    RosArgumentsError
        If `ros_args` or a name in `options` is wrong.
    """
    with BagReader(path) as reader:
        try:
            names = published_names(reader.topics, options)
        except ValueError as err:
            raise ValueError(f"{path}: {err}") from err
        use_segment(IMAGES_PROFILE)
        try:
            rclpy.init(args=list(ros_args))
        except RuntimeError as err:
            raise RosArgumentsError(f"wrong ROS arguments: {err}") from err
        with ros_shut_down():
            _BagPlayer(reader, names, options).run()
        for problem in reader.problems:
            print(problem, file=sys.stderr)
        return not reader.problems


def published_names(types: Mapping[str, str], options: ReplayOptions) -> dict[str, str]:
    """Return the name to publish on for each topic of a bag that is to be published.

    Parameters
    ----------
    types : mapping of str to str
        Type of each topic in the bag.

    Raises
    ------
    ValueError
        If there is nothing to publish; the message lists the topics.
    """
    inputs = {name.strip("/"): topic for topic, name in options.remap.items() if name.strip("/") in _INPUTS}
    others = {topic: name for topic, name in options.remap.items() if name.strip("/") not in _INPUTS}
    for topic in others:
        if topic not in types:
            raise ValueError(f"has no topic {topic!r} to remap; there are {', '.join(sorted(types)) or 'none'}")
    names = {topic: topic for topic in types} if options.all_topics else {}
    try:
        found = _found_inputs(types, options, inputs)
    except ValueError:
        if inputs or not (names or others):
            raise
        found = {}
    names.update({topic: f"{name}{_transport(topic, types[topic])}" for name, topic in found.items()})
    names.update(others)
    return names


def _found_inputs(types: Mapping[str, str], options: ReplayOptions, inputs: Mapping[str, str]) -> dict[str, str]:
    """Return the bag's topics by the names of the inputs, the calibration of depth among them if there is one."""
    source, found = topics.find_inputs(types, options.source, inputs, rectify=options.raw)
    if source == "depth":
        with suppress(ValueError):
            source, found_too = topics.find_inputs(types, source, inputs, register=True)
            return found_too if source == "depth" else found
    return found


def _transport(topic: str, kind: str) -> str:
    """Return what image_transport appends to the name of an image."""
    if kind != topics.COMPRESSED_TYPE:
        return ""
    return "/compressedDepth" if topic.endswith("/compressedDepth") else "/compressed"


class _BagPlayer:
    """Publishers for a reader's topics, and the loop that feeds them."""

    def __init__(self, reader: BagReader, names: Mapping[str, str], options: ReplayOptions) -> None:
        self._reader = reader
        self._options = options
        self._start_ns = reader.start_ns + round(options.start_s * 1e9)
        self._end_ns = reader.end_ns + 1
        if options.duration_s is not None:
            self._end_ns = min(self._end_ns, self._start_ns + round(options.duration_s * 1e9))
        if self._start_ns >= self._end_ns:
            lasts_s = (reader.end_ns - reader.start_ns) / 1e9
            raise ValueError(f"{reader.path}: lasts {lasts_s:.3f} s; start at {options.start_s:g} s is behind its end")
        self._node = Node("replay")
        self._publishers = self._create_publishers(names)
        self._clock = self._node.create_publisher(Clock, "/clock", 1) if options.clock else None
        self._n_published = 0

    def run(self) -> None:
        """Publish all there is to publish, and wait until reliable subscribers have it."""
        if self._options.wait:
            self._wait_for_subscribers()
        begin = time.monotonic()
        while rclpy.ok():
            self._play()
            if not self._options.loop:
                break
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=_ACKNOWLEDGED_S))
        seconds = time.monotonic() - begin
        print(f"published {self._n_published} messages on {len(self._publishers)} topics in {seconds:.1f} s")

    def _create_publishers(self, names: Mapping[str, str]) -> dict[str, Publisher]:
        """Return a publisher for each topic of the bag; without those that come with --all but are not installed.

        Raises ValueError where the type of another topic is not installed, or of all of them.
        """
        publishers = {}
        for topic, name in names.items():
            kind = self._reader.topics[topic]
            try:
                message_type = _message_type(kind)
            except (ImportError, AttributeError) as err:
                missing = f"{topic}: its type {kind} is not installed"
                if name != topic:
                    package = kind.partition("/")[0]
                    raise ValueError(f"{self._reader.path}: {missing}; install the ROS package {package}") from err
                print(f"{missing}; it is left out", file=sys.stderr)
                continue
            qos = QoSProfile(depth=_QUEUE_DEPTH)
            if topic.endswith("/tf_static"):
                qos.durability = QoSDurabilityPolicy.TRANSIENT_LOCAL
            try:
                publishers[topic] = self._node.create_publisher(message_type, name, qos)
            except NameValidationException as err:
                raise RosArgumentsError(f"{name!r} is not a name for a topic: {' '.join(str(err).split())}") from err
        if not publishers:
            raise ValueError(f"{self._reader.path}: no topic has a type that is installed")
        return publishers

    def _wait_for_subscribers(self) -> None:
        """Wait until each of the detector's images is subscribed to, or anything where the bag has none."""
        awaited = [publisher for publisher in self._publishers.values() if _role(publisher.topic_name) in _IMAGES]
        needed = len(awaited) or 1
        awaited = awaited or list(self._publishers.values())
        begin, told = time.monotonic(), False
        while rclpy.ok() and sum(publisher.get_subscription_count() > 0 for publisher in awaited) < needed:
            if not told and time.monotonic() - begin > _SILENT_S:
                told = True
                names = ", ".join(publisher.topic_name for publisher in awaited)
                print(f"waiting for subscribers of {names} ({self._hint()})", file=sys.stderr)
            time.sleep(_STEP_S)
        time.sleep(_SETTLE_S)

    def _hint(self) -> str:
        """Return how to start the detector for what is published."""
        names = [publisher.topic_name for publisher in self._publishers.values()]
        roles = {_role(name) for name in names}
        source = next((source for source, partner in topics.PARTNER.items() if partner in roles), "stereo")
        settings = [f" -p source:={source}"] if source != "stereo" else []
        settings += [" -p source.rectify:=true"] if topics.RIGHT_RAW in roles else []
        settings += [" -p source.compressed:=true"] if any("/compressed" in name for name in names) else []
        ros_args = f" --ros-args{''.join(settings)}" if settings else ""
        return f"start them with `ros2 run lrtrav_ros detector{ros_args}`, or begin at once with --no-wait"

    def _play(self) -> None:
        """Publish all messages of the chosen part once, each at its time."""
        begin = time.monotonic()
        seconds = (self._end_ns - self._start_ns) / 1e9
        with tqdm(
            total=round(seconds, 1), unit="s", bar_format=_BAR, disable=not sys.stderr.isatty(), leave=False
        ) as progress:
            for message in self._reader.messages(self._publishers, start_ns=self._start_ns):
                if message.time_ns >= self._end_ns:
                    break
                self._sleep_until(message.time_ns, begin)
                if not rclpy.ok():
                    return
                self._publishers[message.topic].publish(message.data)
                self._n_published += 1
                progress.update((message.time_ns - self._start_ns) / 1e9 - progress.n)

    def _sleep_until(self, time_ns: int, begin: float) -> None:
        """Sleep until a time of the bag has come, `begin` being when its start was, and publish the clock."""
        due = begin + (time_ns - self._start_ns) / 1e9 / self._options.rate
        if (gap_s := due - time.monotonic()) > _LONG_GAP_S:
            print(f"the next message comes in {gap_s:.0f} s, unless the bag's times are damaged", file=sys.stderr)
        while (left_s := due - time.monotonic()) > 0 and rclpy.ok():
            self._publish_clock(time_ns - round(left_s * self._options.rate * 1e9))
            time.sleep(min(left_s, _STEP_S))
        self._publish_clock(time_ns)

    def _publish_clock(self, time_ns: int) -> None:
        if self._clock is not None and rclpy.ok():
            seconds, nanoseconds = divmod(time_ns, 10**9)
            self._clock.publish(Clock(clock=Time(sec=seconds, nanosec=nanoseconds)))


def _message_type(name: str) -> type[Any]:
    """Return the class of a type such as ``sensor_msgs/msg/Image``; raises ImportError where it is not installed."""
    package, _, kind = name.rpartition("/")
    message_type: type[Any] = getattr(importlib.import_module(package.replace("/", ".")), kind)
    return message_type


def _role(topic: str) -> str:
    """Return the last two parts of a name without image_transport's, which is how inputs are called."""
    parts = [part for part in topic.split("/") if part not in ("", "compressed", "compressedDepth")]
    return parts[-1] if parts[-1:] == [topics.DISPARITY] else "/".join(parts[-2:])
