"""Frames as rosbags of ROS 1 and ROS 2."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from lrtrav_ros.frame import Frame
from lrtrav_ros.io.atomic_files import named_errors, scratch_folder, sync_file
from lrtrav_ros.io.bag_messages import ROS2, camera_info_message, disparity_message, header_message, image_message
from lrtrav_ros.io.topics import (
    DEPTH_IMAGE,
    DISPARITY,
    LEFT_IMAGE,
    LEFT_INFO,
    RIGHT_IMAGE,
    RIGHT_INFO,
)

FORMATS = ("mcap", "sqlite3", "rosbag1")

_ROS1 = get_typestore(Stores.ROS1_NOETIC)


def write_stereo_bag(
    path: str | os.PathLike[str],
    frames: Iterable[Frame],
    *,
    format: str = "mcap",  # noqa: A002 - the word for it
    frame_id: str = "left_camera",
) -> None:
    """Write frames as a rosbag, under a temporary name until it is finished.

    Topics are ``/left/image_rect``, ``/left/camera_info``, ``/right/camera_info`` and one of ``/right/image_rect``,
    ``/disparity`` and ``/depth/image_rect`` (float32, metres). Messages carry the frame's stamp as that of the header
    and as the time at which they were received.

    Parameters
    ----------
    path : path
        A folder to make, or a file where `format` is ``rosbag1``.
    frames : iterable of Frame
        Frames with `stamp_ns`, in order of time.
    format : str
        ``mcap`` or ``sqlite3`` for ROS 2, ``rosbag1`` for ROS 1.
    frame_id : str
        Coordinate frame of all messages.

    Raises
    ------
    FileExistsError
        If the path exists.
    ValueError
        If the format is unknown or a frame has no stamp.
    """
    path = Path(path)
    if format not in FORMATS:
        raise ValueError(f"bag format is {format!r}; choose one of {', '.join(FORMATS)}")
    if path.exists():
        raise FileExistsError(f"{path}: exists; remove it or choose another name")
    # The files of a ROS 2 bag carry the folder's name, therefore it is the folder around it that is temporary.
    with scratch_folder(path) as folder, named_errors(path):
        with _Writer(folder / path.name, format) as writer:
            for frame in frames:
                for topic, message in _messages_of(frame, frame_id):
                    writer.write(topic, message, _checked_stamp_ns(frame))
        for file in _files_of(folder / path.name):
            sync_file(file)
        (folder / path.name).replace(path)


def _files_of(bag: Path) -> list[Path]:
    return sorted(bag.iterdir()) if bag.is_dir() else [bag]


class _Writer:
    """Writes messages of ROS 2 into a bag of any format."""

    def __init__(self, path: Path, format: str) -> None:  # noqa: A002
        self._is_ros1 = format == "rosbag1"
        self._bag: Any
        if self._is_ros1:
            self._bag = rosbag1.Writer(path)
        else:
            self._bag = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[format.upper()])
        self._connections: dict[str, Any] = {}

    def __enter__(self) -> _Writer:
        self._bag.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, err: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bag.__exit__(kind, err, trace)

    def write(self, topic: str, message: Any, time_ns: int) -> None:
        """Write a message to a topic, which is made with its first one."""
        kind = message.__msgtype__
        if topic not in self._connections:
            typestore = _ROS1 if self._is_ros1 else ROS2
            self._connections[topic] = self._bag.add_connection(topic, kind, typestore=typestore)
        data = ROS2.serialize_cdr(message, kind)
        self._bag.write(self._connections[topic], time_ns, ROS2.cdr_to_ros1(data, kind) if self._is_ros1 else data)


def _checked_stamp_ns(frame: Frame) -> int:
    if frame.stamp_ns is None:
        raise ValueError(f"frame {frame.name} has no stamp; give stamp_ns")
    return frame.stamp_ns


def _messages_of(frame: Frame, frame_id: str) -> Iterator[tuple[str, Any]]:
    """Yield topic and message of all that a frame holds; calibration first."""
    header = header_message(_checked_stamp_ns(frame), frame_id)
    camera, size = frame.camera, frame.shape
    yield f"/{LEFT_INFO}", camera_info_message(header, camera, size, baseline_m=0.0)
    yield f"/{RIGHT_INFO}", camera_info_message(header, camera, size, baseline_m=camera.baseline_m)
    if frame.left is not None:
        yield f"/{LEFT_IMAGE}", image_message(header, frame.left)
    if frame.right is not None:
        yield f"/{RIGHT_IMAGE}", image_message(header, frame.right)
    if frame.disparity is not None:
        yield f"/{DISPARITY}", disparity_message(header, frame.disparity, camera)
    if frame.depth_m is not None:
        yield f"/{DEPTH_IMAGE}", image_message(header, frame.depth_m)
