"""What was found in a frame as serialised messages, under the names that the nodes publish."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from lrtrav_ros.config import Config
from lrtrav_ros.detector import Detection
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.bag_messages import (
    ROS2,
    disparity_message,
    grid_message,
    ground_pose_message,
    ground_transform_message,
    header_message,
    image_message,
    points_message,
)
from lrtrav_ros.io.pictures import overlay
from lrtrav_ros.io.topics import DISPARITY, LEFT_IMAGE
from lrtrav_ros.mapping.grid import ground_grid
from lrtrav_ros.mapping.ground_frame import GroundFrame
from lrtrav_ros.mapping.points import free_points, obstacle_points
from lrtrav_ros.mapping.segmentation import segmentation_confidence, segmentation_mask, segmentation_points

_SHORT_RANGE = ("short_range/mask", "short_range/occupancy", "short_range/ground_pose", "obstacles", "free", "depth")
_LONG_RANGE = tuple(f"long_range/{name}" for name in ("mask", "occupancy", "confidence", "overlay", "grid"))
_SEGMENTATION = tuple(f"segmentation/{name}" for name in ("mask", "confidence", "points"))


@dataclass(frozen=True, slots=True)
class OutputLayout:
    """What is to be written, and under which layout.

    Attributes
    ----------
    namespace : str
        Stands before the names of topics: empty, or such as ``/front``.
    frame_id : str
        Coordinate frame of the left camera.
    with_left : bool
        Whether the rectified left image is an output, because the bag has the raw one.
    inputs : frozenset of str
        Topics that the frames come from: no output takes their place.
    """

    namespace: str
    frame_id: str
    with_left: bool = False
    inputs: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class OutputMessage:
    """A message in CDR, its topic and its type."""

    topic: str
    type: str
    data: bytes


@dataclass(frozen=True, slots=True)
class FrameOutputs:
    """The messages of one frame, and the stamp of its left image in nanoseconds."""

    stamp_ns: int
    messages: tuple[OutputMessage, ...]


def output_topics(layout: OutputLayout, *, source: str) -> frozenset[str]:
    """Return the topics that are for outputs alone, where disparity has a source, one of `frame.SOURCES`."""
    left = (LEFT_IMAGE,) if layout.with_left else ()
    disparity = () if source == "disparity" else (DISPARITY,)
    names = (*left, *disparity, *_SHORT_RANGE, *_LONG_RANGE, *_SEGMENTATION)
    return frozenset(f"{layout.namespace}/{name}" for name in names) - layout.inputs


def frame_outputs(frame: Frame, detection: Detection, config: Config, layout: OutputLayout) -> FrameOutputs:
    """Return all that was found in a frame of a bag; what needs the ground is left out where it is not in sight."""
    stamp_ns = frame.stamp_ns or 0
    header = header_message(stamp_ns, layout.frame_id)
    found = [part for outputs in _OUTPUTS for part in outputs(header, frame, detection, config)]
    if layout.with_left and frame.left is not None:
        found.append((LEFT_IMAGE, image_message(header, frame.left)))
    messages = (_serialized(name, message, layout) for name, message in found)
    return FrameOutputs(stamp_ns, tuple(message for message in messages if message.topic not in layout.inputs))


def _serialized(name: str, message: Any, layout: OutputLayout) -> OutputMessage:
    kind = message.__msgtype__
    topic = name if name.startswith("/") else f"{layout.namespace}/{name}"
    return OutputMessage(topic, kind, bytes(ROS2.serialize_cdr(message, kind)))


def _short_range(header: Any, frame: Frame, detection: Detection, config: Config) -> Iterator[tuple[str, Any]]:
    short, camera = detection.short_range, frame.camera
    if frame.source != "disparity":
        yield DISPARITY, disparity_message(header, short.disparity, camera)
    yield "short_range/mask", image_message(header, short.mask)
    yield "short_range/occupancy", image_message(header, short.occupancy)
    least_height_m = config.ground.max_step_m
    obstacles = obstacle_points(
        short.disparity, short.occupancy, short.line, camera, config.maps, least_height_m=least_height_m
    )
    yield "obstacles", points_message(header, obstacles)
    yield "free", points_message(header, free_points(short.occupancy, short.line, camera, config.maps))
    yield "depth", image_message(header, camera.depth_m(short.disparity))
    if short.line is not None:
        ground = GroundFrame.of(short.line, camera)
        yield "short_range/ground_pose", ground_pose_message(header, ground)
        yield "/tf", ground_transform_message(header, ground)


def _long_range(header: Any, frame: Frame, detection: Detection, config: Config) -> Iterator[tuple[str, Any]]:
    short, long = detection.short_range, detection.long_range
    yield "long_range/mask", image_message(header, long.mask)
    yield "long_range/occupancy", image_message(header, long.occupancy)
    if long.confidence is not None:
        yield "long_range/confidence", image_message(header, long.confidence)
    yield "long_range/overlay", image_message(header, overlay(detection.image, short.occupancy, long.occupancy))
    yield "long_range/grid", grid_message(header, ground_grid(long.occupancy, short, frame.camera, config.maps))


def _segmentation(header: Any, frame: Frame, detection: Detection, config: Config) -> Iterator[tuple[str, Any]]:
    short, long = detection.short_range, detection.long_range
    yield "segmentation/mask", image_message(header, segmentation_mask(long.occupancy))
    yield "segmentation/confidence", image_message(header, segmentation_confidence(long.occupancy, long.confidence))
    points = segmentation_points(long.occupancy, short.disparity, short.line, frame.camera, config.maps)
    yield "segmentation/points", points_message(header, points)


_OUTPUTS = (_short_range, _long_range, _segmentation)
