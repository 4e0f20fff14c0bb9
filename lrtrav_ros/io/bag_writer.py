"""Frames as rosbags of ROS 1 and ROS 2."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.encodings import encode_image
from lrtrav_ros.io.image_files import DISPARITY_SCALE
from lrtrav_ros.io.topics import (
    DEPTH_IMAGE,
    DISPARITY,
    DISPARITY_TYPE,
    IMAGE_TYPE,
    INFO_TYPE,
    LEFT_IMAGE,
    LEFT_INFO,
    RIGHT_IMAGE,
    RIGHT_INFO,
)

FORMATS = ("mcap", "sqlite3", "rosbag1")

_ROS1 = get_typestore(Stores.ROS1_NOETIC)
_ROS2 = get_typestore(Stores.ROS2_JAZZY)


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
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    temporary.mkdir(parents=True)
    try:
        with _Writer(temporary / path.name, format) as writer:
            for frame in frames:
                for topic, message in _messages_of(frame, frame_id):
                    writer.write(topic, message, _checked_stamp_ns(frame))
        (temporary / path.name).replace(path)
    finally:
        shutil.rmtree(temporary)


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
            typestore = _ROS1 if self._is_ros1 else _ROS2
            self._connections[topic] = self._bag.add_connection(topic, kind, typestore=typestore)
        data = _ROS2.serialize_cdr(message, kind)
        self._bag.write(self._connections[topic], time_ns, _ROS2.cdr_to_ros1(data, kind) if self._is_ros1 else data)


def _checked_stamp_ns(frame: Frame) -> int:
    if frame.stamp_ns is None:
        raise ValueError(f"frame {frame.name} has no stamp; give stamp_ns")
    return frame.stamp_ns


def _messages_of(frame: Frame, frame_id: str) -> Iterator[tuple[str, Any]]:
    """Yield topic and message of all that a frame holds; calibration first."""
    header = _header(_checked_stamp_ns(frame), frame_id)
    camera, size = frame.camera, frame.shape
    yield f"/{LEFT_INFO}", _camera_info(header, camera, size, baseline_m=0.0)
    yield f"/{RIGHT_INFO}", _camera_info(header, camera, size, baseline_m=camera.baseline_m)
    if frame.left is not None:
        yield f"/{LEFT_IMAGE}", _image_message(header, frame.left)
    if frame.right is not None:
        yield f"/{RIGHT_IMAGE}", _image_message(header, frame.right)
    if frame.disparity is not None:
        yield f"/{DISPARITY}", _disparity_message(header, frame.disparity, camera)
    if frame.depth_m is not None:
        yield f"/{DEPTH_IMAGE}", _image_message(header, frame.depth_m)


def _header(stamp_ns: int, frame_id: str) -> Any:
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    stamp = _ROS2.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    return _ROS2.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def _image_message(header: Any, image: NDArray[Any]) -> Any:
    encoded = encode_image(image)
    return _ROS2.types[IMAGE_TYPE](
        header=header,
        height=encoded.height,
        width=encoded.width,
        encoding=encoded.encoding,
        is_bigendian=0,
        step=encoded.step,
        data=encoded.data,
    )


def _region(height: int, width: int) -> Any:
    return _ROS2.types["sensor_msgs/msg/RegionOfInterest"](
        x_offset=0, y_offset=0, height=height, width=width, do_rectify=False
    )


def _camera_info(header: Any, camera: StereoCamera, size: tuple[int, ...], *, baseline_m: float) -> Any:
    """Return the calibration of the camera that stands `baseline_m` to the right of the left one."""
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    return _ROS2.types[INFO_TYPE](
        header=header,
        height=size[0],
        width=size[1],
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], np.float64),
        r=np.eye(3).reshape(-1),
        p=np.array([fx, 0, cx, -fx * baseline_m, 0, fy, cy, 0, 0, 0, 1, 0], np.float64),
        binning_x=0,
        binning_y=0,
        roi=_region(0, 0),
    )


def _disparity_message(header: Any, disparity: NDArray[np.float32], camera: StereoCamera) -> Any:
    """Return a DisparityImage, of which the invalid pixels (0) are below the least valid disparity."""
    valid = disparity[disparity > 0]
    return _ROS2.types[DISPARITY_TYPE](
        header=header,
        image=_image_message(header, disparity),
        f=camera.fx,
        t=camera.baseline_m,
        valid_window=_region(*disparity.shape),
        min_disparity=float(valid.min(initial=np.inf)) if valid.size else 1.0,
        max_disparity=float(valid.max(initial=1.0)),
        delta_d=1 / DISPARITY_SCALE,
    )
